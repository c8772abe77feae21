"""A run by the dense engine: blocks of steps in arrays, the chains of digests over their bytes, and its outcome."""

import math
import time
from collections.abc import Iterable, Sequence

import numpy as np

from deltaswarm_dense import layout
from deltaswarm_dense.branching import NO_KEYS, Redrawn, redraw_of, until_turn
from deltaswarm_dense.layout import MAX_ORDERS
from deltaswarm_dense.modelled import Models, Uplinked, is_modelled
from deltaswarm_dense.operating import Operator, messages_of
from deltaswarm_dense.results import events_of, step_records, told_s, totals_of_operator, workloads
from deltaswarm_dense.setting_up import Room, draw_losses, set_up
from deltaswarm_dense.step import advance
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.engine import NOTHING_MORE, UncoveredError, Wanted
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.digest import SIZE_BYTES, next_link
from deltaswarm_wire.operator_messages import Workload, read_own_report
from deltaswarm_world.core.air.channel.loss import Loss
from deltaswarm_world.core.arrays import Floats, generator
from deltaswarm_world.core.world import WorldCore

BLOCK_STEPS = 500

GROWS = {layout.CHILDREN: "branches", layout.KNOWN: "beliefs", layout.OLD_FRAME: "slots"}
"""Of what a run that is in some trouble needs more room; it is begun again with twice as much."""

MAX_ROOM = 4096

WORLD, OPERATOR = 0, 1
"""The digest of which part."""


def run_dense(scenario: Scenario, wanted: Wanted = NOTHING_MORE) -> Outcome:
    """Do a covered run, until its end; return the outcome that `run_in_process` returns.

    Raises:
        UncoveredError: the run needs what the arrays have no room for.
    """
    delay_s = scenario.radio.latency_s + scenario.radio.jitter_s
    has_commander = scenario.has_commander or (wanted.turn is not None and wanted.turn.scenario.has_commander)
    room = Room(slots=2, orders=MAX_ORDERS if has_commander else 0)
    if is_modelled(scenario):
        room = room._replace(slots=3 + math.ceil(delay_s / scenario.run.step_s))
    while True:
        run = DenseRun(scenario, wanted, room)
        trouble = run.advance()
        if not trouble:
            return run.outcome()
        name = GROWS.get(trouble)
        if name is None or getattr(room, name) >= MAX_ROOM:
            raise UncoveredError(layout.TROUBLE[trouble])
        room = room._replace(**{name: 2 * getattr(room, name)})


class DenseRun:
    """One run in arrays."""

    def __init__(self, scenario: Scenario, wanted: Wanted, room: Room) -> None:
        self._began = time.monotonic()
        self._scenario = scenario
        self._world = WorldCore(scenario)
        """For what does not change in a run that is covered, for the base of the operator, and for models."""
        self._turn, redraw = wanted.turn, redraw_of(wanted.turn)
        is_redrawn_air = redraw is not None and scenario.radio.loss > 0.0
        self._models = Models(scenario, self._world) if is_modelled(scenario) or is_redrawn_air else None
        self._uplinked = Uplinked(scenario, uplink) if (uplink := self._world.uplink) else None
        environment, has_models = self._world.environment, self._models is not None
        self._swarm = set_up(scenario, environment, room, is_modelled=has_models, redraw=redraw)
        self._counts = np.zeros(scenario.run.steps, layout.COUNTS)
        self._done = 0
        self._chains = [bytes(SIZE_BYTES), bytes(SIZE_BYTES)]
        """The states of the world's and of the operator's digest."""
        self._lossy = generator(scenario.seed, Loss.stream)
        self._stopped = wanted.stopped
        self._workloads: list[Workload] = []
        self._above = 0
        """Steps with a message rate above the threshold, of those that the operator has taken in."""
        has_operator = scenario.has_console or wanted.turn is not None
        self._operator = Operator(scenario, self._world, wanted.folder) if has_operator else None
        self._redrawn: Redrawn | None = None

    def advance(self) -> int:
        """Do all steps; return the trouble that ended them, 0 if there was none."""
        steps, swarm, models = self._scenario.run.steps, self._swarm, self._models
        while self._done < steps and not self._stopped():
            first = self._done
            swarm.output.ends[:] = 0
            block = until_turn(self._turn, first, min(first + BLOCK_STEPS, steps)) - first
            is_redrawn = self._make_turn(first)
            if models is not None or self._scenario.uplink.range_m is not None or (is_redrawn and self._uplinked):
                block = 1  # between steps they need to know where agents are, or are seeded
            if models is not None and (trouble := models.begin(swarm, first)):
                return trouble
            if self._operator is not None:
                self._operator.begin(swarm, first, *self._before(first))
                block = self._operator.steps_from(first, block)
            counts = self._counts[first : first + block]
            draw_losses(swarm.air, self._lossy)
            keys = self._redrawn.keys(first, block) if self._redrawn is not None and is_redrawn else NO_KEYS
            done = advance(swarm, first, block, steps, counts, keys)
            if trouble := int(swarm.trouble[0]):
                return trouble
            self._done += done
            self._close(first, counts[:done])
        return 0

    def _make_turn(self, step: int) -> bool:
        """Before a step, make the difference of a branch that is due; return whether generators are seeded in it."""
        if (turn := self._turn) is None or self._operator is None:
            return False
        if step == turn.step:
            if turn.randomness is not None:
                self._redrawn = Redrawn(self._scenario, turn.randomness, self._world, self._operator.console)
            if turn.console is not None:
                self._scenario = turn.scenario
                self._operator.go_on_with(turn.scenario, *turn.console)
        if self._redrawn is None or step < turn.at_step:
            return False
        self._redrawn.begin_step(step)
        self._operator.begin_step = self._redrawn.begin_close
        return True

    def _before(self, step: int) -> tuple[Floats, list[bool]]:
        """Return where agents will be in a step (`step.move`), and which of them listen."""
        positions_m, listening = self._whereabouts()
        if self._models is None and step > 0:
            agents, settings = self._swarm.agents, self._swarm.settings[0]
            moved_m = np.stack([agents["vx_mps"], agents["vy_mps"]], axis=1) * settings["step_s"]
            positions_m = (positions_m + moved_m).clip(0.0, (settings["width_m"], settings["height_m"]))
        return positions_m, listening

    def _whereabouts(self) -> tuple[Floats, list[bool]]:
        """Return where agents are, and which of them listen."""
        agents = self._swarm.agents
        listening = self._models.listening if self._models else [True] * len(agents)
        return np.stack([agents["x_m"], agents["y_m"]], axis=1), listening

    def _close(self, first: int, counts: np.ndarray) -> None:
        """Hash what was said in some steps, and let the operator take it in."""
        output = self._swarm.output
        said = _parts(output.world, counts["world_end"])
        reported = _parts(output.operator, counts["operator_end"])
        if self._models is not None:
            self._models.end(self._swarm, counts[0], first)
        if self._uplinked is not None:
            self._hash(WORLD, zip(said, reported, strict=True))
            whereabouts = self._whereabouts()
            for step, reports in enumerate(reported, start=first):
                workload = self._uplinked.carry(self._swarm, step, *whereabouts, reports)
                if self._operator is not None:
                    self._operator.end([workload], [self._uplinked.meter.reports_of_closed_step])
            return
        self._hash(WORLD, zip(said, strict=True))
        self._hash(OPERATOR, zip(reported, strict=True))
        if self._operator is not None:
            rows = workloads(self._scenario, self._counts["reports"][: self._done], first, self._above)
            self._operator.end(rows, ([read_own_report(data) for *_, data in messages_of(part)] for part in reported))
            self._above = round(rows[-1].time_above_s / self._scenario.run.step_s)
            self._workloads += rows

    def _hash(self, which: int, steps: Iterable[Sequence[memoryview]]) -> None:
        """Add the messages of some steps to a digest."""
        for parts in steps:
            if any(parts):
                self._chains[which] = next_link(self._chains[which], parts)

    def outcome(self) -> Outcome:
        """Return what the run recorded."""
        scenario, counts, steps, models = self._scenario, self._counts[: self._done], self._done, self._models
        complete = steps == scenario.run.steps
        uplinked, sequences = self._uplinked, self._swarm.agents["sequence"]
        agent_steps = models.agent_steps if models else scenario.agents.count * steps
        changes = [part.records for part in (models, uplinked) if part is not None]
        outcome = Outcome(
            step_records=step_records(scenario, counts, self._world.air.reasons, changes),
            events=events_of(self._swarm.world.events),
            world=self._world.totals(complete)
            | {
                "digest": self._chains[WORLD].hex(),
                "agent_steps": {"due": agent_steps, "answered": agent_steps},
                "refused_claims": int(counts["refused_claims"].sum()),
                "faults": models.faults if models else [],
                "wall_s": time.monotonic() - self._began,
            },
            operator={"complete": complete},
        )
        if uplinked is not None:
            outcome.workloads, outcome.told_s = uplinked.workloads, uplinked.meter.told_s
            outcome.operator |= {"digest": uplinked.meter.digest_hex, **uplinked.meter.totals}
        else:
            outcome.workloads = self._workloads if self._operator else workloads(scenario, counts["reports"])
            outcome.told_s = told_s(self._swarm.world.events)
            by_agent = sequences + models.reports_before if models else sequences
            outcome.operator["digest"] = self._chains[OPERATOR].hex()
            outcome.operator |= totals_of_operator(scenario, counts, by_agent)
        if self._operator is not None and scenario.has_console:
            self._operator.finish(outcome)
        return outcome


def _parts(buffer: np.ndarray, ends: np.ndarray) -> list[memoryview]:
    """Return the bytes of each step."""
    data, until = buffer.data, ends.tolist()
    return [data[begin:end] for begin, end in zip([0, *until], until, strict=False)]
