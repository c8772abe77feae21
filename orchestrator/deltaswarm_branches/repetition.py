"""Repeat a run once, whole, keep its state at the steps where branches leave it, and go on from there."""

from collections.abc import Iterable
from dataclasses import dataclass

from deltaswarm_branches.parent import Parent
from deltaswarm_branches.plan import Plan
from deltaswarm_orchestrator.base import inputs
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.exits import FAILED, CommandError, Reporter
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.processes.elsewhere import PYTHON
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.choosing import DoneBy, run_here
from deltaswarm_orchestrator.run.engine import Wanted
from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process
from deltaswarm_orchestrator.run.randomness import Randomness
from deltaswarm_orchestrator.run.state import KeptState, RunState
from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_wire.plugin_errors import described, is_interrupt


@dataclass(frozen=True)
class Repetition:
    """A run that was repeated."""

    parent: Parent
    past: Outcome
    states: dict[int, KeptState]
    """By the step before which each was kept."""
    from_step: int
    """The step from which it was repeated: 0, or that after a checkpoint."""

    def state_for(self, plan: Plan) -> RunState:
        """Return the state from which a branch goes on."""
        return self.states[plan.turn_step].load(self.past)

    def finish(self, plan: Plan, seed: int | None = None, asked: str = "") -> tuple[Outcome, DoneBy]:
        """Do the rest of a run as `go_on` does, or the whole of it by the dense engine, where that can.

        `asked`: as in `planned_by`.

        Raises:
            CommandError: the dense engine is asked for, and cannot do it.
        """
        if (because := self._why_not_whole(plan, seed)) and asked != PYTHON:
            if asked:
                raise CommandError(f"--engine {asked} cannot do this branch: {because}")
            return self.go_on(plan, seed), DoneBy(PYTHON, because)
        wanted = Wanted(turn=plan.turn(None if seed is None else Randomness(seed)))
        return run_here(self.parent.scenario, wanted, asked=asked, in_python=lambda *_: self.go_on(plan, seed))

    def _why_not_whole(self, plan: Plan, seed: int | None) -> str:
        """Return why a branch is not the same run from the beginning in an engine without agents' states."""
        before, after = self.parent.scenario.operator, plan.scenario.operator
        reasons = {
            "only the checkpoint of a killed run is known": self.parent.digest is None,
            "controllers start anew during the run": plan.restarts_agents,
            "operator.threshold_hz changes during the run": before.threshold_hz != after.threshold_hz,
            "faults are drawn anew": seed is not None and bool(plan.scenario.fault),
        }
        return next((because for because, holds in reasons.items() if holds), "")

    def go_on(self, plan: Plan, seed: int | None = None) -> Outcome:
        """Do the rest of a run from its branching point; with a seed, everything random from there on is drawn anew."""
        if seed is None:
            return run_in_process(self.parent.scenario, state=self.state_for(plan), before=plan.before)
        randomness = Randomness(seed)

        def before(swarm: InProcess, step: int) -> None:
            plan.before(swarm, step, seed)
            if step == plan.at_step:
                swarm.world.redraw(seed)
            if step >= plan.at_step:
                randomness.begin_step(step)

        state = self.states[plan.turn_step].load(self.past, randomness.load)
        return run_in_process(self.parent.scenario, state=state, before=before)


def repeat(parent: Parent, steps: Iterable[int], reporter: Reporter, *, needs_console: bool) -> Repetition:
    """Repeat a run to its digest, from its checkpoint if it has one; keep its state before each of some steps.

    `needs_console`: whether a branch has other orders or settings, for which a console has listened from the beginning.

    Raises:
        CommandError: it does not repeat to its digest, or its state cannot be kept.
    """
    wanted_steps, states = set(steps), dict[int, KeptState]()
    state = _from_checkpoint(parent, min(wanted_steps), needs_console)

    def keep(swarm: InProcess, step: int) -> None:
        if step in wanted_steps:
            states[step] = _kept(swarm, parent, step)

    with TemporaryFolder() as folder:
        wanted = Wanted(
            folder=folder if parent.scenario.has_console else None,
            reporter=reporter,
            listens=state is None or state.cores.console is not None,
        )
        past = run_in_process(parent.scenario, wanted, state, keep)
    for what, was, now in (
        ("digest", parent.digest, past.digest),
        ("events_digest", parent.manifest.get("events_digest"), past.events_digest),
    ):
        if was not in (None, now):
            because = "; ".join(past.messages) or inputs.why_other(parent.manifest, parent.scenario)
            raise CommandError(f"RUN must repeat to its {what} {was} (got {now}: {because})", FAILED)
    return Repetition(parent, past, states, len(state.step_records) if state else 0)


def _from_checkpoint(parent: Parent, before_step: int, needs_console: bool) -> RunState | None:
    """Return the run from its checkpoint, if that is early enough and has all that is needed."""
    if parent.checkpoint is not None and parent.checkpoint.step < before_step:
        state = RunState.read(parent.folder, parent.checkpoint)
        if state.cores.console is not None or not needs_console:
            return state
    if parent.digest is None:
        first_s = (parent.checkpoint.step + 1 + FIRST_STEP) * parent.step_s if parent.checkpoint else 0.0
        go_on = command_line("run", "--resume", parent.folder)
        raise CommandError(
            f"--at must be at least {first_s:g} s in a killed run, which has nothing but its checkpoint, and what is "
            f"different must need no operator that the run lacks; or let the run end before: {go_on}"
        )
    return None


def _kept(swarm: InProcess, parent: Parent, step: int) -> KeptState:
    try:
        return swarm.state.kept()
    except BaseException as error:  # of a plug-in
        if is_interrupt(error):
            raise
        why = f"the state of {parent.folder} must be kept before step {step}: {described(error)}"
        raise CommandError(why, FAILED) from None
