"""Files of a run folder, for commands that only look whether they are there: nothing is imported for them."""

RECORDING, WIRE, PART = "recording.mcap", "wire.mcap", ".part"
"""What viewers show, every raw frame, and what is added to their names while they are written."""

COMMANDS = "commands.toml"
"""The commands that left the base, as `deltaswarm run --commands` takes them: the same run again."""

DEEDS = "deeds.csv"
"""What the person at the station does, row by row while the run is under way."""
