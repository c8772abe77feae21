"""The developers' measurements of speed and memory, from a clone: `python -m benchmarks`."""
