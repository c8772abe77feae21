"""Checkpoints of a run: after which steps there is one, and where its parts are.

    RUN/checkpoint/newest.json              the step after which all is saved, and who was there
    RUN/checkpoint/<step>/world.pickle      each part writes its own
    RUN/checkpoint/<step>/agent-<id>.pickle
    RUN/checkpoint/<step>/operator.json

A checkpoint is unpickled, and so can do whatever a program can: go on only with runs of your own.
"""

from pathlib import Path

from deltaswarm_wire.files import write_whole

FOLDER, NEWEST = "checkpoint", "newest.json"
WORLD_FILE, OPERATOR_FILE = "world.pickle", "operator.json"


def is_due(step: int, every_steps: int) -> bool:
    """Whether there is a checkpoint after this step; with 0 there is none."""
    return every_steps > 0 and (step + 1) % every_steps == 0


def agent_file(agent: int) -> str:
    """What an agent calls its part."""
    return f"agent-{agent}.pickle"


def write(file: Path, data: bytes) -> None:
    """Write a file whole or not at all. Its folder is made; the one above must be there."""
    file.parent.mkdir(exist_ok=True)
    write_whole(file, data)
