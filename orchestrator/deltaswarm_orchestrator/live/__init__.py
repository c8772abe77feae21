"""A run while it is under way, for viewers: none of them can slow it."""
