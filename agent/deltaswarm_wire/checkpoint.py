"""Checkpoints of a run: their steps and their files.

    RUN/checkpoint/newest.json              step, agents, and digests of files, scenario and tables at the newest one
    RUN/checkpoint/<step>/world.pickle      each part writes its own
    RUN/checkpoint/<step>/agent-<id>.pickle
    RUN/checkpoint/<step>/operator.json

A checkpoint is unpickled and can therefore run arbitrary code: resume only your own runs.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from deltaswarm_wire.files import write_whole

FOLDER, NEWEST = "checkpoint", "newest.json"
WORLD_FILE, OPERATOR_FILE = "world.pickle", "operator.json"


def is_due(step: int, every_steps: int) -> bool:
    """Whether a checkpoint is due after this step; 0 means never."""
    return every_steps > 0 and (step + 1) % every_steps == 0


def agent_file(agent: int) -> str:
    return f"agent-{agent}.pickle"


def files(folder: Path, agents: Iterable[int]) -> list[Path]:
    """The files of a checkpoint in its own folder."""
    return [folder / name for name in (WORLD_FILE, OPERATOR_FILE, *map(agent_file, agents))]


def write(file: Path, data: bytes) -> None:
    """Write a file atomically. Create its folder, whose parent must exist."""
    file.parent.mkdir(exist_ok=True)
    write_whole(file, data)


def digest(data: bytes) -> str:
    import hashlib  # costs a board 4 MB, and no agent needs it

    return hashlib.sha256(data).hexdigest()


def table_seals(folder: Path, sizes: Mapping[str, int]) -> dict[str, Sequence[int | str]]:
    """Return length [bytes] and digest of tables in a run's folder, up to these lengths. Raises OSError."""
    return {name: (size, digest((folder / name).read_bytes()[:size])) for name, size in sizes.items()}


def check_tables(folder: Path, seals: Mapping[str, Sequence[Any]]) -> None:
    """Check tables against what `table_seals` returned."""
    for name, (size, sealed) in seals.items():
        data = (folder / name).read_bytes()
        if len(data) < size:
            raise ValueError(f"{name} must have at least {size} bytes (got {len(data)})")
        if digest(data[:size]) != sealed:
            raise ValueError(f"{name} has been changed or damaged")


def sealed(content: Mapping[str, Any]) -> bytes:
    """Encode as JSON that shows whether it was changed."""
    return json.dumps({**content, "seal": digest(json.dumps(content).encode())}).encode()


def unsealed(data: bytes) -> dict[str, Any]:
    """Decode. Raises ValueError if it is damaged, or was changed."""
    content = json.loads(data)
    if not isinstance(content, dict) or content.pop("seal", None) != digest(json.dumps(content).encode()):
        raise ValueError("it has been changed or damaged")
    return content
