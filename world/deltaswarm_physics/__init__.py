"""Robots that take up room: discs on wheels that collide, by the physics engine Chipmunk (docs/BODIES.md)."""
