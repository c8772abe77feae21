"""The tests, flat: `test_<part>_<module>.py` mirrors the module; `test_processes_*` start real processes.

What takes too long for each time: `DELTASWARM_LONG=1 pytest tests/test_namespaces_*` (boards on separate machines, in
full length, 10 minutes), `DELTASWARM_EXPLORE=1 pytest` (properties with other examples, each time anew), and
`python -m tests.soak` (a board's memory over a day).
"""
