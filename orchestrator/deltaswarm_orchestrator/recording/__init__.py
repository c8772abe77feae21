"""Write a run's recording as MCAP, and read it back."""
