"""Record runs. This file has the names of a run's files and imports nothing, for commands that only look for files."""

RECORDING, WIRE, PART = "recording.mcap", "wire.mcap", ".part"
"""The recording for viewers, the raw frames, and the suffix that both have while they are written."""

SCENARIO, MANIFEST = "scenario.toml", "manifest"
"""A recording's attachment with the effective scenario, and its last record, the manifest."""

LAYOUT = "layout.json"
"""A layout for viewers of the recording."""

COMMANDS = "commands.toml"
"""The commands that left the base, in the format of `deltaswarm run --commands`, to repeat the run."""

VALUES = "value"
"""The folder beside a run's results with what its orders were worth, sealed by itself."""

ACTIONS = "actions.csv"
"""The actions of the person at the station, written row by row during the run."""
