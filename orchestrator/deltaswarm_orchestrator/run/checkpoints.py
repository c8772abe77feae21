"""Checkpoints of a run in one process: write its state between two steps as its parts would, or go on from theirs."""

import base64
import json
import pickle
from collections import Counter, deque
from pathlib import Path

from deltaswarm_operator.io.console_server import SavedConsole
from deltaswarm_operator.io.files import OperatorFiles
from deltaswarm_orchestrator.results.folder import FolderError
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.results.run_tables import read_outcome
from deltaswarm_orchestrator.run.in_process import Begun, Cores
from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_wire import checkpoint
from deltaswarm_wire.operator_messages import Workload
from deltaswarm_wire.plugin_errors import is_interrupt
from deltaswarm_world.core.pace import TimeoutBackoff
from deltaswarm_world.io import saving
from deltaswarm_world.io.files import WorldOutput


def write(folder: Path, begun: Begun) -> None:
    """Write tables and checkpoint of a run after its newest step, from which processes can go on as well.

    The console's tables are in the folder already, if it has any. Raises OSError.
    """
    cores, sizes = begun.cores, begun.table_bytes
    step, console = cores.world.participants.step, None
    newest = folder / checkpoint.FOLDER / str(step)
    newest.mkdir(parents=True)
    for agent, core in cores.agents.items():
        checkpoint.write(newest / checkpoint.agent_file(agent), pickle.dumps((core, step)))
    if cores.console is not None and cores.world.scenario.has_console:
        console = SavedConsole(cores.console, deque(maxlen=FIRST_STEP), sizes)
    with OperatorFiles(folder, Workload._fields) as operator:
        for workload in begun.workloads:
            operator.row(workload)
        operator.save((cores.operator, console))
        operator.checkpoint(step, sizes)
    with WorldOutput(folder, cores.world.columns) as world:
        for record in begun.step_records:
            world.write(record, cores.world.environment.states() if record.step == step else ())
        backoff = TimeoutBackoff(cores.world.scenario.run.step_timeout_s)
        saving.save(folder, saving.SavedWorld(cores.world, backoff, cores.restarts, world.sync()))


def read(folder: Path, resumed: Resumed) -> Begun:
    """Return the run of a checkpoint that `resume.newest` has checked.

    Raises:
        FolderError: a file of it cannot be read.
    """
    at = folder / checkpoint.FOLDER / str(resumed.step)
    try:
        saved = saving.load(folder, resumed.step)
        files = {agent: at / checkpoint.agent_file(agent) for agent in resumed.agents}
        agents = {agent: pickle.loads(file.read_bytes())[0] for agent, file in files.items()}
        state = json.loads((at / checkpoint.OPERATOR_FILE).read_text(encoding="utf-8"))["state"]
        meter, console = pickle.loads(base64.b64decode(state))
        outcome = read_outcome(folder)
    except BaseException as error:  # a plug-in's state may raise anything
        if is_interrupt(error):
            raise
        raise FolderError(f"the checkpoint in {at} cannot be used: {error!r}") from None
    meter.resume()
    done = resumed.step + 1
    return Begun(
        Cores(saved.core, agents, Counter(saved.restarts), meter, console.console if console else None),
        outcome.step_records[:done],
        outcome.workloads[:done],
        dict(console.table_bytes) if console else {},
    )
