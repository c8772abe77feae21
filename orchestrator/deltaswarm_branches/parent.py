"""The parent of a branch: a run that can be repeated, with the orders that were given in it."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_cli.arguments import A_RUN
from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.paths import must_exist
from deltaswarm_orchestrator.inspect.info import read_run
from deltaswarm_orchestrator.inspect.repeating import WALL_TIMES, refuse_branch, repeated
from deltaswarm_orchestrator.recording import COMMANDS, SCENARIO
from deltaswarm_orchestrator.results import resume
from deltaswarm_orchestrator.results.folder import FolderError
from deltaswarm_orchestrator.results.folder_lock import is_held
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.results.run_tables import RUNNING, read_rows
from deltaswarm_orchestrator.run.options import unsaved
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.operator_links import FIRST_STEP, CommandSettings
from deltaswarm_scenario.person_tables import SCRIPT
from deltaswarm_scenario.scenario import Scenario


class Order(NamedTuple):
    """An order that left the base."""

    number: int
    step: int
    """The step in which it left."""
    by: str
    """Who gave it: person, simulated, script or system."""
    command: CommandSettings


@dataclass(frozen=True)
class Parent:
    """A run from which branches are made."""

    folder: Path
    scenario: Scenario
    """What repeats the run: with a person's orders as a script, and as many steps as the run had."""
    digest: str | None
    """None: the run was killed, and can only go on from its checkpoint."""
    orders: Sequence[Order]
    manifest: dict[str, Any]
    checkpoint: Resumed | None
    """Its newest checkpoint, if it was interrupted and has one."""

    @property
    def step_s(self) -> float:
        """Length of a step [s]."""
        return self.scenario.run.step_s

    @property
    def steps(self) -> int:
        """Number of steps, also of a branch."""
        return self.scenario.run.steps

    @property
    def has_rule(self) -> bool:
        """Whether a simulated person or the system gives orders in the repetition."""
        return self.scenario.operator.commands

    @property
    def identity(self) -> dict[str, Any]:
        """What a branch's manifest says about its parent."""
        told = {name: self.manifest.get(name) for name in ("name", "seed", "started", "code")}
        return {"folder": str(self.folder.resolve()), "digest": self.digest, **told}


def read_parent(folder: Path) -> Parent:
    """Read a run from its folder, and refuse one that cannot be repeated.

    Raises:
        CommandError, SettingsError: it is no run, is under way, was damaged, or cannot be repeated.
    """
    must_exist(folder, "RUN", A_RUN, or_part=False)
    written, outcome = read_run(folder)
    manifest = seal.read_sealed(folder / seal.MANIFEST)
    refuse_branch(folder, manifest)
    if written.run.bound != "none":
        raise CommandError(f"RUN must have agents with a controller (got a bound, run.bound = {written.run.bound!r})")
    if why := unsaved(written):
        dynamics = written.world.dynamics
        raise CommandError(f"RUN must have bodies that can be saved (got world.dynamics = {dynamics!r}: {why})")
    if manifest.get("exit_reason") == RUNNING and is_held(folder):
        raise CommandError(f"RUN must have ended (got {folder}, which is under way)")
    checkpoint = _checkpoint(folder, written)
    digest, steps = manifest.get("digest"), len(outcome.step_records)
    if digest is None and checkpoint is None:
        go_on = command_line("run", "--resume", folder)
        raise CommandError(f"RUN must have a digest or a checkpoint (got {folder}, which was killed); try: {go_on}")
    scenario = repeated(folder, manifest)
    if digest is not None:
        if not steps:
            raise CommandError(f"RUN must have done at least one step (got {folder})")
        run = dataclasses.replace(scenario.run, duration_s=steps * scenario.run.step_s)
        scenario = dataclasses.replace(scenario, run=run)
    return Parent(folder, scenario, digest, _orders(folder, scenario), manifest, checkpoint)


def _checkpoint(folder: Path, scenario: Scenario) -> Resumed | None:
    """Return the checkpoint of an interrupted run of this version; None without one."""
    if (folder / WALL_TIMES).exists():  # its console waits for a person
        return None
    try:
        resume.check_inputs(folder, scenario)
        return resume.newest(folder)
    except FolderError:
        return None


def _orders(folder: Path, scenario: Scenario) -> tuple[Order, ...]:
    """Return the orders that left the base, in order, numbered as on the page and in `commands.csv`.

    A killed run has not written them; those of its script are known.
    """
    if (folder / COMMANDS).exists():
        given = load_scenario(str(folder / SCENARIO), commands=folder / COMMANDS).command
        by = [row["by"] for row in read_rows(folder / "commands.csv")] or [SCRIPT] * len(given)
    else:
        given = tuple(sorted(scenario.command, key=lambda command: command.at_s))
        by = [SCRIPT] * len(given)
    steps = [max(FIRST_STEP, round(command.at_s / scenario.run.step_s)) for command in given]
    rows = enumerate(zip(steps, by, given, strict=False))
    return tuple(Order(number, *row) for number, row in rows if row[0] < scenario.run.steps)
