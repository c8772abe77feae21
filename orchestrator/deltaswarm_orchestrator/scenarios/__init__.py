"""The built-in scenarios, and how scenarios are read."""
