"""The shipped controllers; each is one file or folder, and a line in `deltaswarm_wire.plugins`."""
