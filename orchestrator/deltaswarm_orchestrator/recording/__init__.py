"""A run's recording: written as MCAP, and read again."""
