"""What a run leaves: its folder, its tables and summary, and the checkpoints from which it can go on."""
