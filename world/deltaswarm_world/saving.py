"""The world's part of a checkpoint, which makes it whole: the others have written theirs before."""

import json
import pickle
import shutil
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from deltaswarm_wire import checkpoint
from deltaswarm_world.config import WorldConfig
from deltaswarm_world.core import WorldCore
from deltaswarm_world.lockstep import Patience


@dataclass
class SavedWorld:
    """All of a world that goes on; one that has not begun is a `new` one."""

    core: WorldCore
    patience: Patience
    restarts: Counter[int] = field(default_factory=Counter)
    """How often each agent was started anew, on order."""
    table_bytes: Sequence[int] = ()
    """How long the world's tables were; empty: there were none."""
    wall_s: float = 0.0
    """Wall time since the first step began, without the time in which the run was not under way [s]."""
    overruns: int = 0

    @classmethod
    def new(cls, config: WorldConfig) -> Self:
        """Before the first step."""
        scenario = config.scenario
        return cls(WorldCore(scenario, config.boards), Patience(scenario.run.step_timeout_s))


def save(run_folder: Path, saved: SavedWorld) -> None:
    """Write the world, and that there is a checkpoint after its newest step; delete the one before. Raises OSError."""
    lockstep, folder = saved.core.lockstep, run_folder / checkpoint.FOLDER
    checkpoint.write(folder / str(lockstep.step) / checkpoint.WORLD_FILE, pickle.dumps(saved))
    told = {"step": lockstep.step, "agents": sorted(lockstep.alive), "restarts": list(saved.restarts.items())}
    checkpoint.write(folder / checkpoint.NEWEST, json.dumps(told).encode())
    for other in folder.iterdir():
        if other.name.isdecimal() and int(other.name) < lockstep.step:
            shutil.rmtree(other, ignore_errors=True)


def load(run_folder: Path, step: int) -> SavedWorld:
    """The world after a step.

    Raises:
        ValueError: its file cannot be read.
    """
    file = run_folder / checkpoint.FOLDER / str(step) / checkpoint.WORLD_FILE
    try:
        saved = pickle.loads(file.read_bytes())
        if not isinstance(saved, SavedWorld):
            raise TypeError(f"no world in it, but a {type(saved).__name__}")
    except Exception as error:  # whatever is in the file
        raise ValueError(f"--resume {step}: {file} cannot be read: {error!r}") from error
    return saved
