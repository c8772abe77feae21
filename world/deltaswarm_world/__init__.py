"""The world: physics, the air between the radios, and the truth."""
