"""The world's core: one step at a time, frames out, acts and radio frames in, truth and record out.

Inputs are processed in agent order, never in arrival order; `intake.py` takes and checks them.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import accumulate
from operator import itemgetter
from typing import Any

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import COLUMNS, DROP_REASONS, Sample, StepRecord, Truth
from deltaswarm_wire.codec import tuple_of
from deltaswarm_wire.commands import BASE_ID
from deltaswarm_wire.digest import Digest
from deltaswarm_wire.messages import FRAME_ROOM_BYTES, MAX_SENSED, NOBODY, SENSED_BYTES, Event, Frame, Heard, TreeStatus
from deltaswarm_wire.operator_messages import Forwarded
from deltaswarm_wire.orders import KILL, START, ProcessOrder
from deltaswarm_world.core.air.channel.links import Diagnosis
from deltaswarm_world.core.air.radio import Air
from deltaswarm_world.core.air.reception import Reception
from deltaswarm_world.core.bookkeeping import Bookkeeping, ClosedStep, samples_of, truth_of
from deltaswarm_world.core.crashes import Crashes
from deltaswarm_world.core.downlink import Downlink
from deltaswarm_world.core.environment import Environment
from deltaswarm_world.core.faults.timeline import Faults
from deltaswarm_world.core.intake import Intake
from deltaswarm_world.core.participants import Participants, as_rows
from deltaswarm_world.core.sleep_schedule import SleepSchedule
from deltaswarm_world.core.turns import AWAITED, OFF, Turns
from deltaswarm_world.core.uplink.uplink import Uplink

HEARD_BYTES = 6
"""Overhead of a heard frame in an agent's frame: its sender and length."""

NOBODY_HIT: frozenset[int] = frozenset()


def untimed(phase: str) -> None:
    """Do not measure."""


class WorldCore:
    """The world of one run, with `scenario.agents.count` agents numbered from 0."""

    def __init__(self, scenario: Scenario, boards: Iterable[int] = (), metrics: Sequence[str] = ()) -> None:
        self.scenario = scenario
        self.environment = Environment(scenario)
        self.participants = Participants(range(scenario.agents.count), boards)
        self.intake = Intake(self.participants)
        self.refused_claims = 0
        """Number of claimed observations of events out of sensing range."""
        self.events_cut = 0
        """Number of sensed events that did not fit into a frame."""
        self.forwarded: list[Forwarded] = []
        """Reports that reach the operator in the last closed step."""

        self.air = Air(scenario)
        self.uplink = Uplink(scenario, self.air.steady_links) if scenario.uplink.is_on else None
        """None: each report reaches the operator in the step in which it is sent."""
        self.turns = Turns(AWAITED if scenario.has_commander else OFF)
        self.downlink = Downlink(scenario)
        self._delivered: list[tuple[int, bytes]] = []
        """(agent, sample) of base frames received in this step."""
        self._sent: list[tuple[int, bytes]] = []
        self._forwarded_ever = 0
        self._books = Bookkeeping(scenario, self.environment.density, self.air.reasons, metrics)
        self._closed: ClosedStep | None = None
        self._faults = Faults(scenario) if scenario.fault else None
        count = scenario.agents.count
        self._alive = set(range(count))
        """Agents that had a process when this step began."""
        self._crashes = Crashes()
        self._listening = self._speaking = [True] * count
        """Agents with a working receiver in this step, and in the step before, when the frames heard now were sent."""
        self._tree_statuses: dict[int, TreeStatus] = {}
        """Each present agent's tree status, by its last act."""
        self._sleep = SleepSchedule(count, ask_all=scenario.run.ask_every_step)
        self._sensed: list[list[Event]] = []
        self.links: Sequence[tuple[int, int]] = ()
        """(sender, receiver) of each frame heard in this step."""
        self._step = -1
        self._is_last = False
        self._time_s = 0.0
        self._carried = Reception(0)

    @property
    def closed(self) -> ClosedStep:
        assert self._closed is not None, "close a step first"
        return self._closed

    @property
    def digest(self) -> Digest:
        """The digest of all booked steps."""
        return self._books.digest

    @property
    def agents_in_trees(self) -> int:
        return self._books.agents_in_trees

    @property
    def is_deserted(self) -> bool:
        """Whether no agent is left, not by faults alone, and no fault may start one."""
        return self.participants.is_deserted and not (self._faults and self._faults.may_start_agents)

    @property
    def is_last(self) -> bool:
        """Whether this step is the last one, as planned, by a signal, or because no agent is left."""
        return self._is_last

    # A step: inject and begin, then acts and radio frames as they arrive, then close and book, which may wait until the
    # next step has begun

    def inject(self, step: int) -> Sequence[ProcessOrder]:
        """Apply the faults before a step, and the last one's crashes; return the orders for agents' processes."""
        time_s = step * self.scenario.run.step_s
        crashed = self._crashes.fail(self.environment.dynamics.crashes, self.participants, step, time_s)
        if self._faults is None:
            return crashed
        participants = self.participants
        roots = [agent for agent, status in self._tree_statuses.items() if status.root == agent]
        orders = self._faults.inject(step, participants.present, roots)
        for order in orders:
            for agent in order.agents:
                self._sleep.wake(agent)
                if order.action == KILL:
                    participants.kill(agent)
                    self.environment.command(agent, 0.0, 0.0)
                elif order.action == START:
                    participants.token_back(agent)
                    self.expect_new_process(agent, step)
        participants.freeze(self._faults.frozen)
        return [*crashed, *orders]

    def expect_new_process(self, agent: int, step: int) -> None:
        """Expect a new process of an agent, which begins with this step and knows nothing of those before."""
        self._sleep.start(agent, step)
        self.intake.expect_new_process(agent)

    def go_on_with(self, scenario: Scenario) -> None:
        """Between two steps, go on by a scenario that only differs at the operator."""
        self.scenario = scenario
        self.turns.mode = AWAITED if scenario.has_commander else OFF

    def redraw(self, seed: int) -> None:
        """Redraw with another seed what happens after the last closed step and is not drawn yet.

        The generators that the models of the air have drawn from are not replaced.
        """
        self.environment.redraw(seed, self._time_s)
        if self._faults is not None:
            self._faults.redraw(seed)

    def begin(
        self, step: int, last: bool, probe: bool = False, lap: Callable[[str], None] = untimed
    ) -> Iterator[tuple[int, Frame]]:
        """Move bodies, let events arrive, compute sensing and hearing; yield each awake agent's frame.

        With `probe`, hung boards get a frame, too. `lap` gets the name of each part that is over.
        """
        environment, participants = self.environment, self.participants
        self._step, self._time_s, self._is_last = step, step * self.scenario.run.step_s, last
        taking_part = participants.taking_part()
        probed = participants.probe() if probe else []
        alive = participants.present
        for agent in alive ^ self._alive:
            self._sleep.wake(agent)
            environment.command(agent, 0.0, 0.0)
        self._alive = alive
        while participants.returned:
            self._sleep.wake(participants.returned.pop())  # even if it left and came back within a step
        environment.changed.clear()
        if step > 0:
            environment.move(*(self._faults.drive, self._faults.active) if self._faults else ())
        environment.arrive(self._time_s)
        self.downlink.send(step, self.turns.leaving(step, self.scenario.run.step_s))
        self._sensed = self._sense((*taking_part, *probed))
        lap("begin")
        heard = self._hear(taking_part)
        lap("radio")
        self._sleep.move_to(environment.positions_m.tolist())
        always = participants.boards.keys() | (self._faults.affected if self._faults else NOBODY_HIT)
        always |= environment.hindered
        asked = taking_part if last else self._sleep.due(step, taking_part, self._sensed, heard, always)
        participants.begin(step, asked)
        before = self._tree_statuses
        if list(before) == taking_part:
            self._tree_statuses = before.copy()  # a closed step keeps the other one
        else:
            self._tree_statuses = {agent: before[agent] for agent in taking_part if agent in before}
        self.intake.begin(step)
        lap("begin")
        return self._frames((*asked, *probed), last, heard)

    def _frames(self, agents: Iterable[int], last: bool, heard: list[list[Heard]]) -> Iterator[tuple[int, Frame]]:
        for agent in agents:
            yield agent, self._frame(agent, last, heard[agent])

    def _frame(self, agent: int, last: bool, heard: Sequence[Heard]) -> Frame:
        here, poses = self._sleep.ask(agent, self._step)
        sensed = self._sensed[agent]
        if len(sensed) > MAX_SENSED:
            self.events_cut += len(sensed) - MAX_SENSED
            sensed = sensed[:MAX_SENSED]
        felt = agent in self.environment.dynamics.bumped, agent in self.environment.dynamics.blocked
        fields = (self._step, self._time_s, last, *here, poses, tuple(sensed), tuple(heard), *felt)
        frame: Frame = tuple_of(Frame, fields)
        return frame

    def _sense(self, agents: Iterable[int]) -> list[list[Event]]:
        """Return what these agents sense, with faults applied; an agent without a frame senses nothing."""
        faults, environment = self._faults, self.environment
        present = [False] * self.scenario.agents.count
        for agent in agents:
            present[agent] = True
        if faults is None:
            return environment.sense(self._time_s, present)
        sensed = environment.sense(self._time_s, faults.seeing(present), faults.misses)
        faults.distort(sensed, environment.positions_m)
        return sensed

    def _hear(self, taking_part: Sequence[int]) -> list[list[Heard]]:
        """Deliver the radio frames of the step before; return each agent's received frames with their senders."""
        deaf, mute = (self._faults.deaf, self._faults.mute) if self._faults else (NOBODY_HIT, NOBODY_HIT)
        listening = [False] * self.scenario.agents.count
        for agent in taking_part:
            listening[agent] = agent not in deaf
        self._speaking, self._listening = self._listening, listening
        reception = self.air.carry(
            self._step, self._time_s, self.intake.transmitted, self.environment.positions_m, listening, mute
        )
        self.links = reception.links
        if cut := self._cut_overfull(reception.heard, reception.largest_bytes):
            self.links = [(sender, agent) for agent, frames in enumerate(reception.heard) for sender, _ in frames]
            reception.drop("frame_full", cut)
        self._delivered = self.downlink.carry(self._step, self._time_s, self.environment.positions_m, listening)
        for agent, data in self._delivered:
            reception.heard[agent].append((BASE_ID, data))
        self._carried = reception
        return reception.heard

    def _cut_overfull(self, heard: list[list[Heard]], largest_bytes: int) -> int:
        """Drop frames that do not fit into their receiver's frame; return their number."""
        largest = largest_bytes + HEARD_BYTES
        least_room = FRAME_ROOM_BYTES - SENSED_BYTES * MAX_SENSED
        cut = 0
        for frames, sensed in zip(heard, self._sensed, strict=True):
            if len(frames) * largest <= least_room:
                continue  # they always fit
            room = FRAME_ROOM_BYTES - SENSED_BYTES * min(MAX_SENSED, len(sensed))
            ends = list(accumulate(len(data) + HEARD_BYTES for _, data in frames))
            fitting = bisect_right(ends, room)
            cut += len(frames) - fitting
            del frames[fitting:]
        return cut

    def end(self) -> StepRecord:
        self.close()
        return self.book()

    def close(self, *, with_events: bool = False) -> None:
        """Carry out the step's acts, and keep what `book` and, with its events, `truth` need after the next `begin`."""
        late = self.participants.time_out()
        self._is_last |= self.is_deserted
        self.intake.drop_frames(late)
        observers: Counter[int] = Counter()
        acts, environment = self.intake.acts, self.environment
        for agent in sorted(acts):
            act = acts[agent][1]
            environment.command(agent, act.vx_mps, act.vy_mps)
            if act.observed:
                claimed = set(act.observed)
                observed = claimed.intersection(map(itemgetter(0), self._sensed[agent]))
                observers.update(observed)
                self.refused_claims += len(claimed) - len(observed)
            self._tree_statuses[agent] = act.tree_status
            self._sleep.hold(agent, act)
        environment.work(observers, self._time_s)
        for agent in late:
            self._tree_statuses.pop(agent, None)
            self._sleep.wake(agent)
        self._forward()
        rejected, lost = self.intake.drain_counts()
        events_open = len(environment.active)
        if self._is_last:  # what arrives until the end is part of the run, whatever the length of a step
            environment.arrive(self._time_s + self.scenario.run.step_s)
        self._closed = ClosedStep(
            step=self._step,
            time_s=self._time_s,
            is_last=self._is_last,
            late=len(late),
            present=frozenset(self.participants.present),
            acts=acts,
            transmitted=self.intake.transmitted,
            delivered=self._delivered,
            sent=self._sent,
            arrived=len(self.forwarded),
            tree_statuses=self._tree_statuses,
            positions_m=environment.positions_m,
            bodies=environment.dynamics.states(),
            links=self.links,
            reception=self._carried,
            under_way=self.air.under_way,
            rejected=rejected,
            lost=lost,
            changed=[event.state() for event in environment.changed],
            shown=environment.states_to_show() if with_events else None,
            events_open=events_open,
            events_completed=environment.completed,
        )

    def book(self) -> StepRecord:
        """Add the closed step to the digest; return its record. Call it once per step, before the next `close`."""
        return self._books.enter(self.closed, self.uplink)

    def _forward(self) -> None:
        """Forward this step's reports, or those that the uplink delivers, to the operator in agent order."""
        self._sent = self.intake.drain_reports(self._is_last)
        arrived = [data for _, data in self._sent] if self.uplink is None else self._carry_up(self.uplink)
        first = self._forwarded_ever
        self.forwarded = [Forwarded(first + number, self._step, data) for number, data in enumerate(arrived)]
        self._forwarded_ever += len(arrived)

    def _carry_up(self, uplink: Uplink) -> list[bytes]:
        """Pass reports into the uplink, one of each agent; return the delivered ones."""
        sent: dict[int, bytes] = {}
        for agent, data in self._sent:
            sent.setdefault(agent, data)
        reachable = set(self.participants.taking_part()) - (self._faults.deaf if self._faults else NOBODY_HIT)
        there = [agent in reachable for agent in range(self.scenario.agents.count)]
        roots = {agent: status.root for agent, status in self._tree_statuses.items() if status.root != NOBODY}
        return uplink.carry(self._step, self._time_s, self.environment.positions_m, there, roots, sent)

    @property
    def columns(self) -> list[str]:
        """The columns of a step's record: with one for each reason of a drop and each own number."""
        dropped = [f"dropped_{reason}" for reason in self.air.reasons if reason not in DROP_REASONS]
        end = COLUMNS.index("reports_sent")
        return [*COLUMNS[:end], *dropped, *COLUMNS[end:], *self._books.own_columns]

    def truth(self, row: StepRecord) -> Truth:
        """Return the full state of the closed step for the recorder; its events are those of `close`, or of now."""
        shown = self.closed.shown
        return truth_of(self.closed, row, self.environment.states_to_show() if shown is None else shown)

    def explain(self, sender: int, receiver: int | None) -> tuple[list[Diagnosis], list[str]]:
        """Explain one agent's link to another, or to the operator (None), in the last closed step; change nothing.

        Return each model's finding, and what became of the frames or reports. What is heard in a step was sent in the
        step before. Without an uplink model nothing is found about the operator's link.
        """
        if receiver is None:
            return ([], []) if self.uplink is None else (self.uplink.explain(sender), self.uplink.outcomes(sender))
        outcomes = self.air.outcomes(sender, receiver)
        for _ in range(outcomes.count("delivered") - list(self.links).count((sender, receiver))):
            outcomes[outcomes.index("delivered")] = "dropped: frame_full"
        return self.air.explain(sender, receiver, self._speaking), outcomes

    def losses(self) -> tuple[list[tuple[int, int, str]], list[tuple[int, str]]]:
        """Return why messages were lost: sender, receiver and reason of frames, and sender and reason of reports.

        The frames are those that this step's drops count, and the reports those of the last closed step.
        """
        frames = self._carried.losses(self._listening)
        full = Counter(self._carried.links) - Counter(self.links)
        frames += [(sender, receiver, "frame_full") for sender, receiver in full.elements()]
        return frames, self.uplink.losses if self.uplink else []

    @property
    def samples(self) -> list[Sample]:
        """The raw radio frames and reports of the closed step, in agent order."""
        return samples_of(self.closed)

    def totals(self, complete: bool) -> dict[str, Any]:
        return {
            "complete": complete,
            "digest": self.digest.hex(),
            "agents_lost": list(self.participants.lost),
            "lost_in_step": list(self.participants.lost_in_step),
            "agent_steps": {"due": self.participants.due, "answered": self.participants.answered},
            "agents_failed": as_rows(self.participants.failed),
            "agents_late": as_rows(self.participants.late),
            "deserted": self.participants.is_deserted,
            "boards": {str(agent): asdict(attendance) for agent, attendance in self.participants.boards.items()},
            "faults": list(self._faults.log) if self._faults else [],
            **self.intake.totals,
            "refused_claims": self.refused_claims,
            "events_cut": self.events_cut,
            "targets": self.environment.targets(),
            "bodies": self.environment.dynamics.totals,
            "commands": self.turns.log,
            "downlink": self.downlink.totals,
        }
