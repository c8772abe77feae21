"""One run: its scenario, processes, folder and results."""
