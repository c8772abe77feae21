"""Bodies with inertia (docs/BODIES.md): discs on wheels that collide, by Chipmunk, and quadcopters, by JSBSim."""
