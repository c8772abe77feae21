"""The processes of a run: how they start, their command lines, and how they end."""
