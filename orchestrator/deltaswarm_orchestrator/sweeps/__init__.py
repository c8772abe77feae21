"""Sweeps: many runs that differ in some keys, done side by side, resumed, and gathered in one table."""
