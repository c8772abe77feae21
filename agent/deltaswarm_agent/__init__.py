"""The agent: decides from what its own sensor and its own radio tell it, and nothing else."""
