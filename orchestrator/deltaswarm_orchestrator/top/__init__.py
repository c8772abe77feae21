"""`deltaswarm top`: a run under way, on a terminal."""
