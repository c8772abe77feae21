"""The shipped bodies."""
