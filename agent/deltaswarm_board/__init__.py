"""An agent on a board: with a body of its own, in open air, by the wall clock."""
