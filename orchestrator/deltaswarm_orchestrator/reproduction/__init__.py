"""The paper's results out of our own runs: conditions, figures, and a verdict on each of its claims."""
