"""An agent that turns against the run it is part of: what each attack costs, and whom.

`python -m tests.hostile` tries all of them at full size; the tests, at a small one.
"""
