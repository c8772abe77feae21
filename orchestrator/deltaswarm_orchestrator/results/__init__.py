"""Results of a run: its folder, tables and summary, and the checkpoints to resume from."""
