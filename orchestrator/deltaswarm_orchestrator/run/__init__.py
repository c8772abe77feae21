"""One run: its scenario, its processes, its folder, what came of it."""
