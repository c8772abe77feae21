"""Random signals at random moments to random parts of real runs, and a judge that knows what must hold.

`python -m tests.storm --runs 100 --seed 1` prints a table; the tests do ten.
"""
