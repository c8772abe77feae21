"""The tests, flat: `test_<part>_<module>.py` mirrors the module; `test_processes_*` start real processes."""
