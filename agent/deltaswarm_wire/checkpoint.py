"""Checkpoints of a run: their steps and their files.

    RUN/checkpoint/newest.json              step, agents and files' digests of the newest complete checkpoint
    RUN/checkpoint/<step>/world.pickle      each part writes its own
    RUN/checkpoint/<step>/agent-<id>.pickle
    RUN/checkpoint/<step>/operator.json

A checkpoint is unpickled and can therefore run arbitrary code: resume only your own runs.
"""

from collections.abc import Iterable
from pathlib import Path

from deltaswarm_wire.files import write_whole

FOLDER, NEWEST = "checkpoint", "newest.json"
WORLD_FILE, OPERATOR_FILE = "world.pickle", "operator.json"


def is_due(step: int, every_steps: int) -> bool:
    """Whether a checkpoint is due after this step; 0 means never."""
    return every_steps > 0 and (step + 1) % every_steps == 0


def agent_file(agent: int) -> str:
    """The file name of an agent's part."""
    return f"agent-{agent}.pickle"


def files(folder: Path, agents: Iterable[int]) -> list[Path]:
    """The files of a checkpoint in its own folder."""
    return [folder / name for name in (WORLD_FILE, OPERATOR_FILE, *map(agent_file, agents))]


def write(file: Path, data: bytes) -> None:
    """Write a file atomically. Create its folder, whose parent must exist."""
    file.parent.mkdir(exist_ok=True)
    write_whole(file, data)


def digest(file: Path) -> str:
    """Return a file's SHA-256 in hexadecimal digits. Raises OSError."""
    import hashlib  # costs a board 4 MB, and no agent needs it

    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
