"""Places changed at random in every kind of stored result: `python -m tests.tampering`."""
