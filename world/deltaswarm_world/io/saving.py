"""What a world starts from: its configuration, and its part of a checkpoint, which is written last."""

import pickle
import shutil
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, Self

from deltaswarm_scenario.scenario import Scenario, scenario_digest
from deltaswarm_wire import checkpoint
from deltaswarm_wire.foreign import Foreign, name_of
from deltaswarm_wire.keys import OPERATOR
from deltaswarm_wire.plugin_errors import PluginError, is_interrupt
from deltaswarm_wire.session import RouterLink
from deltaswarm_world.core.pace import TimeoutBackoff
from deltaswarm_world.core.world import WorldCore
from deltaswarm_world.io.files import TABLES


@dataclass(frozen=True)
class WorldConfig:
    run: str
    scenario: Scenario
    link: RouterLink
    credentials: Path
    """File of `user:password` lines, one per process."""
    out: Path
    expect: tuple[str, ...] = (OPERATOR,)
    """Roles, besides the agents, that must be ready before the first step."""
    publish_truth: bool = False
    publish_wire: bool = False
    """Publish every raw radio frame and report, for a recorder."""
    listen: tuple[str, ...] = ()
    """Endpoints; default: the link's."""
    checkpoint_steps: int = 0
    """Interval of checkpoints in steps; 0: never."""
    has_station: bool = False
    """Accept commands and pace from a person, without waiting for turns."""
    boards: tuple[int, ...] = ()
    """Agents on machines of their own, which may leave and come back."""
    time_phases: bool = False
    """Measure where the steps' wall time goes, for `world.json`."""
    metrics: tuple[str, ...] = ()


@dataclass
class SavedWorld:
    """The full state of a world, also of a `new` one."""

    core: WorldCore
    backoff: TimeoutBackoff
    restarts: Counter[int] = field(default_factory=Counter)
    """Restarts of each agent by orders."""
    table_bytes: Sequence[int] = ()
    """Lengths of the world's tables; empty: no tables yet."""
    wall_s: float = 0.0
    """Wall time since the first step, without interruptions of the run [s]."""
    overruns: int = 0

    @classmethod
    def new(cls, config: WorldConfig) -> Self:
        """Make a world, and check that it can be saved, if needed. Raises PluginError."""
        scenario = config.scenario
        saved = cls(WorldCore(scenario, config.boards, config.metrics), TimeoutBackoff(scenario.run.step_timeout_s))
        if config.checkpoint_steps:
            pickled(saved)
        return saved


class _Pickler(pickle.Pickler):
    newest = "the world"
    """The newest plug-in that was reached: if pickling fails, the one that cannot be saved."""

    def reducer_override(self, thing: Any) -> Any:
        if isinstance(thing, Foreign):
            self.newest = name_of(type(vars(thing)["_plugin"]))
        return NotImplemented  # pickle it as usual


def pickled(saved: SavedWorld) -> bytes:
    """Pickle a world. Raises PluginError: a plug-in cannot be saved."""
    pickler = _Pickler(data := BytesIO())
    try:
        pickler.dump(saved)
    except BaseException as error:  # a plug-in may raise anything
        if is_interrupt(error):
            raise
        raise PluginError(f"{pickler.newest} cannot be saved in a checkpoint", error) from error
    return data.getvalue()


def missing(run_folder: Path, step: int, agents: Iterable[int]) -> set[int]:
    folder = run_folder / checkpoint.FOLDER / str(step)
    return {agent for agent in agents if not (folder / checkpoint.agent_file(agent)).is_file()}


def has_operator(run_folder: Path, step: int) -> bool:
    """Whether the operator's file is in a checkpoint; one that was killed may have confirmed the step without it."""
    return (run_folder / checkpoint.FOLDER / str(step) / checkpoint.OPERATOR_FILE).is_file()


def save(run_folder: Path, saved: SavedWorld) -> None:
    """Write the world, mark the checkpoint as complete, delete the one before. Raises OSError, PluginError."""
    participants, folder = saved.core.participants, run_folder / checkpoint.FOLDER
    newest = folder / str(participants.step)
    checkpoint.write(newest / checkpoint.WORLD_FILE, pickled(saved))
    agents = sorted(participants.present)
    files = checkpoint.files(newest, agents)
    content = {
        "step": participants.step,
        "agents": agents,
        "sha256": {file.name: checkpoint.digest(file.read_bytes()) for file in files},
        "scenario": scenario_digest(saved.core.scenario),
        "restarts": list(saved.restarts.items()),
        "tables": checkpoint.table_seals(run_folder, dict(zip(TABLES, saved.table_bytes, strict=True))),
    }
    checkpoint.write(folder / checkpoint.NEWEST, checkpoint.sealed(content))
    for other in folder.iterdir():
        if other.name.isdecimal() and int(other.name) < participants.step:
            shutil.rmtree(other, ignore_errors=True)


def load(run_folder: Path, step: int) -> SavedWorld:
    """Load the world's state after a step."""
    file = run_folder / checkpoint.FOLDER / str(step) / checkpoint.WORLD_FILE
    try:
        saved = pickle.loads(file.read_bytes())
        if not isinstance(saved, SavedWorld):
            raise TypeError(f"must hold a world (got {type(saved).__name__})")
    except Exception as error:  # the file may raise anything
        raise ValueError(f"--resume must name a readable checkpoint: {file}: {error!r} (got {step})") from error
    return saved
