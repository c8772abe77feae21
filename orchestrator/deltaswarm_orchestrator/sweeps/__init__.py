"""Sweeps: run many variants of a scenario in parallel, resume them, and gather the results in one table."""
