"""Repeat a run once, whole, and keep its state at the steps where branches leave it."""

import pickle
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from deltaswarm_branches.parent import Parent
from deltaswarm_orchestrator.base import inputs
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.exits import FAILED, CommandError, Reporter
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run import checkpoints
from deltaswarm_orchestrator.run.in_process import Begun, InProcess, run_in_process
from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_wire.files import naming
from deltaswarm_wire.plugin_errors import described, is_interrupt


@dataclass(frozen=True)
class State:
    """The state of a run before a step."""

    step: int
    cores: bytes
    tables: dict[str, bytes]
    """What the console's tables hold."""

    def begun(self, past: Outcome, load: Callable[[bytes], Any] = pickle.loads) -> Begun:
        """Return the run that goes on from here; `past` has all steps of the repetition."""
        sizes = {name: len(data) for name, data in self.tables.items()}
        return Begun(load(self.cores), past.step_records[: self.step], past.workloads[: self.step], sizes)


@dataclass(frozen=True)
class Trunk:
    """A run that was repeated."""

    past: Outcome
    states: dict[int, State]
    """By the step before which each was kept."""
    from_step: int
    """The step from which it was repeated: 0, or that after a checkpoint."""


def repeat(parent: Parent, steps: Iterable[int], reporter: Reporter, *, needs_console: bool) -> Trunk:
    """Repeat a run to its digest, from its checkpoint if it has one; keep its state before each of some steps.

    `needs_console`: whether a branch has other orders or settings, for which a console has listened from the beginning.

    Raises:
        CommandError: it does not repeat to its digest, or its state cannot be kept.
    """
    wanted, states = set(steps), dict[int, State]()
    begun = _from_checkpoint(parent, min(wanted), needs_console)

    def keep(swarm: InProcess, step: int) -> None:
        if step in wanted:
            states[step] = State(step, _pickled(swarm, parent, step), swarm.tables)

    with TemporaryFolder() as folder:
        for name, size in begun.table_bytes.items() if begun else ():
            with naming(table := folder / name):
                table.write_bytes((parent.folder / name).read_bytes()[:size])
        past = run_in_process(
            parent.scenario,
            None,
            reporter,
            folder=folder if parent.scenario.has_console else None,
            begun=begun,
            before=keep,
            listens=begun is None or begun.cores.console is not None,
        )
    first = len(begun.step_records) if begun else 0
    for what, was, now in (
        ("digest", parent.digest, past.digest),
        ("events_digest", parent.manifest.get("events_digest"), past.events_digest),
    ):
        if was not in (None, now):
            because = "; ".join(past.messages) or inputs.why_other(parent.manifest, parent.scenario)
            raise CommandError(f"RUN must repeat to its {what} {was} (got {now}: {because})", FAILED)
    return Trunk(past, states, first)


def _from_checkpoint(parent: Parent, before_step: int, needs_console: bool) -> Begun | None:
    """Return the run from its checkpoint, if that is early enough and has all that is needed."""
    if parent.checkpoint is not None and parent.checkpoint.step < before_step:
        begun = checkpoints.read(parent.folder, parent.checkpoint)
        if begun.cores.console is not None or not needs_console:
            return begun
    if parent.digest is None:
        first_s = (parent.checkpoint.step + 1 + FIRST_STEP) * parent.step_s if parent.checkpoint else 0.0
        go_on = command_line("run", "--resume", parent.folder)
        raise CommandError(
            f"--at must be at least {first_s:g} s in a killed run, which has nothing but its checkpoint, and what is "
            f"different must need no operator that the run lacks; or let the run end before: {go_on}"
        )
    return None


def _pickled(swarm: InProcess, parent: Parent, step: int) -> bytes:
    try:
        return pickle.dumps(swarm.cores)
    except BaseException as error:  # of a plug-in
        if is_interrupt(error):
            raise
        why = f"the state of {parent.folder} must be kept before step {step}: {described(error)}"
        raise CommandError(why, FAILED) from None
