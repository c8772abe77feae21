"""Runs in arrays: the paper's controllers, bodies and radio, compiled by numba, with the digests of the Python engine.

The Python cores are the specification. Each file here repeats the rules of the file with the same name there, one
compiled function per rule, so that both can be read side by side. `layout.py` has the arrays, `step.py` the step,
`engine.py` what goes in and comes out. `coverage.py` says which scenarios it covers.
"""
