"""The tests by what they need.

`unit/` mirrors the modules of each part; `swarms/` runs whole swarms in one process, `processes/` and `boards/` start
real processes, `pages/` a browser; `docs/` holds the documentation to the code. `support/` is what tests share.

What takes too long for each time: `DELTASWARM_LONG=1 pytest tests/boards/test_namespaces_*` (boards on separate
machines, in full length, 10 minutes), `.ci/nightly` (slow tests, properties with many more examples, storms,
mutants), and `python -m tests.support.soak` (a board's memory over a day).
"""
