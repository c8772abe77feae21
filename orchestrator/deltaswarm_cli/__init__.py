"""The command line `deltaswarm`: the core's commands, above the package for Python."""
