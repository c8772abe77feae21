"""The controllers that are shipped; each is one file or one folder, and a line in `deltaswarm_wire.plugins`."""
