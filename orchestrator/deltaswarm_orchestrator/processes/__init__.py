"""The processes of a run: how they start, what they are told, and how they end."""
