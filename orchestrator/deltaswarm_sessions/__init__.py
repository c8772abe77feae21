"""Studies with participants: the design, one participant's session, and the tables of all."""
