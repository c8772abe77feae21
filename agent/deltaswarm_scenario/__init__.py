"""A scenario's settings and the truth about a run, which no agent gets. Boards do not carry this package."""
