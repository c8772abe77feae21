"""The state of a run between two steps: how it is kept, becomes files, and is read again."""

import base64
import json
import pickle
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deltaswarm_agent.core.agent_core import AgentCore
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_operator.io.console_server import SavedConsole
from deltaswarm_operator.io.files import OperatorFiles
from deltaswarm_orchestrator.results.folder import FolderError
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.results.run_tables import read_outcome
from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire import checkpoint
from deltaswarm_wire.operator_messages import Workload
from deltaswarm_wire.plugin_errors import is_interrupt
from deltaswarm_world.core.pace import TimeoutBackoff
from deltaswarm_world.core.world import WorldCore
from deltaswarm_world.io import saving
from deltaswarm_world.io.files import WorldOutput


@dataclass
class Cores:
    """All objects that decide what comes next."""

    world: WorldCore
    agents: dict[int, AgentCore]
    """Those that are in the run."""
    restarts: Counter[int]
    """How often each agent was started again."""
    operator: WorkloadMeter
    console: Console | None


@dataclass(frozen=True)
class RunState:
    """A run between two steps."""

    cores: Cores
    step_records: Sequence[StepRecord]
    """Of all steps so far."""
    workloads: Sequence[Workload]
    tables: Mapping[str, bytes] = field(default_factory=dict)
    """The contents of the console's tables so far, by name; empty: it has none."""

    @property
    def next_step(self) -> int:
        """Number of the step that comes next."""
        return len(self.step_records)

    def kept(self) -> "KeptState":
        """Return a copy that the run's further steps do not change. Raises what a plug-in raises when it is pickled."""
        return KeptState(self.next_step, pickle.dumps(self.cores), self.tables)

    def write(self, folder: Path) -> None:
        """Write tables and checkpoint into a run's folder, from which processes can go on as well. Raises OSError."""
        cores, console = self.cores, None
        sizes = {name: len(data) for name, data in self.tables.items()}
        step = cores.world.participants.step
        newest = folder / checkpoint.FOLDER / str(step)
        newest.mkdir(parents=True)
        for agent, core in cores.agents.items():
            checkpoint.write(newest / checkpoint.agent_file(agent), pickle.dumps((core, step)))
        for name, data in self.tables.items():
            (folder / name).write_bytes(data)
        if cores.console is not None and cores.world.scenario.has_console:
            console = SavedConsole(cores.console, deque(maxlen=FIRST_STEP), sizes)
        with OperatorFiles(folder, Workload._fields) as operator:
            for workload in self.workloads:
                operator.row(workload)
            operator.save((cores.operator, console))
            operator.checkpoint(step, sizes)
        with WorldOutput(folder, cores.world.columns) as world:
            for record in self.step_records:
                world.write(record, cores.world.environment.states() if record.step == step else ())
            backoff = TimeoutBackoff(cores.world.scenario.run.step_timeout_s)
            saving.save(folder, saving.SavedWorld(cores.world, backoff, cores.restarts, world.sync()))

    @classmethod
    def read(cls, folder: Path, resumed: Resumed) -> "RunState":
        """Read the checkpoint in a run's folder that `resume.newest` has checked.

        Raises:
            FolderError: a file of it cannot be read.
        """
        at = folder / checkpoint.FOLDER / str(resumed.step)
        try:
            saved = saving.load(folder, resumed.step)
            files = {agent: at / checkpoint.agent_file(agent) for agent in resumed.agents}
            agents = {agent: pickle.loads(file.read_bytes())[0] for agent, file in files.items()}
            pickled = json.loads((at / checkpoint.OPERATOR_FILE).read_text(encoding="utf-8"))["state"]
            meter, console = pickle.loads(base64.b64decode(pickled))
            sizes = console.table_bytes if console else {}
            tables = {name: (folder / name).read_bytes()[:size] for name, size in sizes.items()}
            outcome = read_outcome(folder)
        except BaseException as error:  # a plug-in's state may raise anything
            if is_interrupt(error):
                raise
            raise FolderError(f"the checkpoint in {at} cannot be used: {error!r}") from None
        meter.resume()
        cores = Cores(saved.core, agents, Counter(saved.restarts), meter, console.console if console else None)
        done = resumed.step + 1
        return cls(cores, outcome.step_records[:done], outcome.workloads[:done], tables)


@dataclass(frozen=True)
class KeptState:
    """A state whose cores are pickled, to go on from it more than once."""

    next_step: int
    cores: bytes
    tables: Mapping[str, bytes]

    def load(self, past: Outcome, load: Callable[[bytes], Any] = pickle.loads) -> RunState:
        """Return a state to go on from; `past` has all steps of the run, and `load` unpickles the cores."""
        done = self.next_step
        return RunState(load(self.cores), past.step_records[:done], past.workloads[:done], self.tables)
