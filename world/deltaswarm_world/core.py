"""The world's core: one step at a time, frames out, acts and radio frames in, truth and tally out.

Inputs are processed in agent order, never in arrival order. What arrives is checked here: an agent's
bytes are a stranger's.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import accumulate
from typing import Any

from deltaswarm_wire.codec import WireError
from deltaswarm_wire.digest import ACT, RADIO, REPORT, Digest
from deltaswarm_wire.messages import (
    FRAME_ROOM_BYTES,
    MAX_SENSED,
    SENSED_BYTES,
    Act,
    Event,
    Forwarded,
    Frame,
    Report,
    decode_act,
    decode_report,
)
from deltaswarm_wire.orders import KILL, START, Order
from deltaswarm_wire.radio import RadioFrame, decode_radio
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.truth import DROP_REASONS, IN_TREE, UPLINK_REASONS, Body, EventState, Tally, Truth
from deltaswarm_world.air.channel.links import Finding
from deltaswarm_world.air.radio import Air, Carried
from deltaswarm_world.air.trace import TracedAir
from deltaswarm_world.environment import Environment, Happening
from deltaswarm_world.faults.timeline import Faults
from deltaswarm_world.ledger import FREE, Coverage, Numbers, Standing, by_agent, standing
from deltaswarm_world.lockstep import LockStep
from deltaswarm_world.uplink.trace import TracedUplink
from deltaswarm_world.uplink.uplink import Uplink

HEARD_BYTES = 3
"""What a heard frame takes in an agent's frame besides its own bytes."""

NOBODY_HIT: frozenset[int] = frozenset()

NONE_DROPPED = (0,) * len(UPLINK_REASONS)


class WorldCore:
    """The world of one run, with `scenario.agents.count` agents numbered from 0."""

    def __init__(self, scenario: Scenario, boards: Iterable[int] = ()) -> None:
        self.scenario = scenario
        self.environment = Environment(scenario)
        self.lockstep = LockStep(range(scenario.agents.count), boards)
        self.rejected: Counter[int] = Counter()
        """Samples dropped at the edge, per agent whose key they came on."""
        self.refused_claims = 0
        """Observations claimed of events that were out of sensing range."""
        self.agents_in_trees = 0
        """In the last closed step."""
        self.digest = Digest()
        self.has_uplink = scenario.uplink.is_on
        """Whether reports come here, and not straight to the operator."""
        self.forwarded: list[Forwarded] = []
        """The reports that reach the operator in the step just ended, if there is an uplink model."""
        self.reports_passing = 0
        """Reports of this step that went straight to the operator."""

        self._air = Air(scenario)
        self._uplink = Uplink(scenario, self._air.steady_links) if self.has_uplink else None
        self._reports: dict[int, bytes] = {}
        self._forwarded_ever = 0
        self._coverage = Coverage(scenario)
        self._faults = Faults(scenario) if scenario.fault else None
        self._present = [True] * scenario.agents.count
        self._listening = self._speaking = [True] * scenario.agents.count
        self._spoken: dict[int, tuple[bytes, RadioFrame]] = {}
        self._acts: dict[int, tuple[bytes, Act]] = {}
        self._standings: dict[int, Standing] = {}
        self._sensed: list[list[Event]] = []
        self._links: Sequence[tuple[int, int]] = ()
        self._radio_numbers, self._report_numbers = Numbers(), Numbers()
        self._rejected_in_step = 0
        self._lost_before = 0
        self._step = -1
        self._time_s = 0.0
        self._carried = Carried(0)

    # A step: strike and begin, then acts and radio frames as they arrive, then end

    def strike(self, step: int) -> Sequence[Order]:
        """What fails or recovers before a step; the orders are for the agents' processes, the rest is done."""
        if self._faults is None:
            return ()
        lockstep = self.lockstep
        roots = [agent for agent, (role, _, _) in self._standings.items() if role == "root"]
        orders = self._faults.strike(step, lockstep.alive, roots)
        for order in orders:
            for agent in order.agents:
                if order.action == KILL:
                    lockstep.take_out(agent)
                    self.environment.command(agent, 0.0, 0.0)
                elif order.action == START:
                    lockstep.back(agent)
                    self._radio_numbers.begin_anew(agent)
                    self._report_numbers.begin_anew(agent)
        lockstep.frozen = self._faults.frozen
        return orders

    def begin(self, step: int, last: bool) -> Iterable[tuple[int, Frame]]:
        """Move, let events arrive, work out sensing and hearing; yields each agent's frame."""
        environment = self.environment
        self._step, self._time_s = step, step * self.scenario.run.step_s
        taking_part = self.lockstep.begin(step)
        knocked, self.lockstep.knocked = self.lockstep.knocked, []
        alive = self.lockstep.alive
        for agent, there in enumerate(self._present):
            if there != (agent in alive):
                self._present[agent] = not there
                environment.command(agent, 0.0, 0.0)
        environment.take_changed()  # of the step before, if nobody asked for its truth
        if step > 0:
            environment.move(self._faults.drive if self._faults else None)
        environment.arrive(self._time_s)
        self._sensed = self._sense()
        heard = self._hear(taking_part)
        positions = environment.positions_m.tolist()
        self._spoken, self._acts = {}, {}
        for agent in (*taking_part, *knocked):
            x_m, y_m = positions[agent]
            sensed = tuple(self._sensed[agent][:MAX_SENSED])
            yield agent, Frame(step, self._time_s, last, x_m, y_m, sensed, tuple(heard[agent]))

    def board_is_back(self, agent: int) -> None:
        """What a board said while it was away is no loss of the fabric: its numbers go on from wherever they are."""
        self._radio_numbers.go_on_anywhere(agent)
        self._report_numbers.go_on_anywhere(agent)

    def _sense(self) -> list[list[Event]]:
        """What each agent senses, or believes to."""
        faults, environment = self._faults, self.environment
        if faults is None:
            return environment.sense(self._time_s, self._present)
        sensed = environment.sense(self._time_s, faults.seeing(self._present), faults.misses)
        faults.distort(sensed, environment.positions_m)
        return sensed

    def _hear(self, taking_part: Sequence[int]) -> list[list[bytes]]:
        """Deliver the radio frames of the step before; per agent those that reach it."""
        deaf, mute = (self._faults.deaf, self._faults.mute) if self._faults else (NOBODY_HIT, NOBODY_HIT)
        spoken = {agent: data for agent, (data, _) in self._spoken.items()}
        listening = [False] * len(self._present)
        for agent in taking_part:
            listening[agent] = agent not in deaf
        self._speaking, self._listening = self._listening, listening
        carried = self._air.carry(self._step, self._time_s, spoken, self.environment.positions_m, listening, mute)
        heard = carried.heard
        self._links = carried.links
        crowded = self._cut_crowded(heard, carried.largest_bytes)
        if crowded:
            kept = [iter(frames) for frames in heard]
            self._links = [link for link in carried.links if next(kept[link[1]], None) is not None]
            carried.drop("crowded", crowded)
        self._carried = carried
        return heard

    def _cut_crowded(self, heard: list[list[bytes]], largest_bytes: int) -> int:
        """Drop what does not fit into its receiver's frame beside the events sensed; how many frames that is."""
        largest = largest_bytes + HEARD_BYTES
        least_room = FRAME_ROOM_BYTES - SENSED_BYTES * MAX_SENSED
        crowded = 0
        for frames, sensed in zip(heard, self._sensed, strict=True):
            if len(frames) * largest <= least_room:
                continue  # they fit, whichever they are
            room = FRAME_ROOM_BYTES - SENSED_BYTES * min(MAX_SENSED, len(sensed))
            ends = list(accumulate(len(data) + HEARD_BYTES for data in frames))
            fitting = bisect_right(ends, room)
            crowded += len(frames) - fitting
            del frames[fitting:]
        return crowded

    def hear_radio(self, agent: int, data: bytes) -> str | None:
        """Take one radio frame from an agent's key; the reason if it is dropped."""
        try:
            frame = decode_radio(data)
        except WireError as error:
            return self.reject(agent, str(error))
        return self.take_radio(agent, frame, data)

    def take_radio(self, agent: int, frame: RadioFrame, data: bytes) -> str | None:
        """The same for a frame and the bytes that it was decoded from, or encoded to."""
        if frame.sender != agent:
            return self.reject(agent, f"radio.sender: {frame.sender} on the key of agent {agent}")
        self._radio_numbers.follow(agent, frame.counter)
        if agent in self.lockstep.hanging:
            return None  # late: its act, which follows, ends that
        if agent in self._spoken or agent not in self.lockstep.waiting:
            return self.reject(agent, "radio: a second frame in one step, or one out of turn")
        self._spoken[agent] = (data, frame)
        return None

    def hear_report(self, agent: int, data: bytes) -> str | None:
        """Take one report from an agent's key, for the uplink; the reason if it is dropped."""
        try:
            report = decode_report(data)
        except WireError as error:
            return self.reject(agent, str(error))
        return self.take_report(agent, report, data)

    def take_report(self, agent: int, report: Report, data: bytes) -> str | None:
        """The same for a report and the bytes that it was decoded from, or encoded to."""
        if report.agent != agent:
            return self.reject(agent, f"report.agent: {report.agent} on the key of agent {agent}")
        if report.step > self._step:
            return self.reject(agent, f"report.step: {report.step} has not begun, {self._step} has")
        self._report_numbers.follow(agent, report.sequence)
        if agent in self._reports:
            return self.reject(agent, "report: a second one in one step")
        self._reports[agent] = data
        return None

    def hear_act(self, agent: int, data: bytes) -> str | None:
        """Take one act from an agent's key; the reason if it is dropped."""
        try:
            act = decode_act(data)
        except WireError as error:
            return self.reject(agent, str(error))
        return self.take_act(agent, act, data)

    def take_act(self, agent: int, act: Act, data: bytes) -> str | None:
        """The same for an act and the bytes that it was decoded from, or encoded to."""
        if act.step > self._step:
            return self.reject(agent, f"act.step: {act.step} has not begun, {self._step} has")
        if self.lockstep.close(agent, act.step):
            self._acts[agent] = (data, act)
        return None

    def reject(self, agent: int, reason: str) -> str:
        """Count a sample that came on a key of this agent and is dropped; gives the reason back."""
        self.rejected[agent] += 1
        self._rejected_in_step += 1
        return reason

    def end(self) -> Tally:
        """Close the step: commands, work, completion, tally, digest."""
        late = self.lockstep.give_up()
        observers: Counter[int] = Counter()
        for agent in sorted(self._acts):
            data, act = self._acts[agent]
            self.environment.command(agent, act.vx_mps, act.vy_mps)
            if act.observed:
                sensed = {event.event for event in self._sensed[agent]}
                for event in set(act.observed):
                    if event in sensed:
                        observers[event] += 1
                    else:
                        self.refused_claims += 1
            spoken = self._spoken.get(agent)
            if spoken is not None:
                self.digest.add(self._step, agent, RADIO, spoken[0])
            self.digest.add(self._step, agent, ACT, data)
        self.environment.work(observers, self._time_s)
        passing, self.reports_passing = self.reports_passing, 0
        reports = (passing, passing, 0, *NONE_DROPPED) if self._uplink is None else self._forward(self._uplink)
        return self._tally(len(late), reports)

    def _forward(self, uplink: Uplink) -> tuple[int, ...]:
        """Let the reports of this step into the uplink; how many were sent, arrived, are under way, were dropped."""
        sent, self._reports = self._reports, {}
        for agent in sorted(sent):
            self.digest.add(self._step, agent, REPORT, sent[agent])
        lockstep = self.lockstep
        absent = lockstep.hanging | lockstep.frozen | (self._faults.deaf if self._faults else NOBODY_HIT)
        there = [agent in lockstep.alive and agent not in absent for agent in range(len(self._present))]
        spoken = [(agent, frame) for agent, (_, frame) in self._spoken.items()]
        arrived = uplink.carry(self._step, self._time_s, self.environment.positions_m, there, spoken, sent)
        first = self._forwarded_ever
        self.forwarded = [Forwarded(first + number, self._step, data) for number, data in enumerate(arrived)]
        self._forwarded_ever += len(arrived)
        dropped = [uplink.dropped.get(reason, 0) for reason in UPLINK_REASONS]
        return len(sent), len(arrived), uplink.under_way, *dropped

    def _tally(self, late: int, reports: tuple[int, ...]) -> Tally:
        self._standings = {agent: standing(frame) for agent, (_, frame) in self._spoken.items()}
        in_trees = [agent for agent, (role, _, _) in self._standings.items() if role in IN_TREE]
        self.agents_in_trees = len(in_trees)
        due = self._coverage.is_due(self._step)
        rejected, self._rejected_in_step = self._rejected_in_step, 0
        lost = (self._radio_numbers.lost + self._report_numbers.lost).total() - self._lost_before
        self._lost_before += lost
        carried, others = self._carried, self.scenario.agents.count - 1
        figures = (
            self._step,
            self._time_s,
            len(self.lockstep.alive),
            late,
            len(in_trees),
            sum(role == "root" for role, _, _ in self._standings.values()),
            self._coverage.area_m2(self.environment.positions_m[in_trees]) if due else None,
            len(self.environment.active),
            len(self._spoken),
            sum(len(data) for data, _ in self._spoken.values()),
            len(self._links),
            carried.duplicated,
            len(self._spoken) * others + self._air.under_way,
            *[carried.dropped.get(reason, 0) for reason in DROP_REASONS],
            *reports,
            rejected,
            lost,
        )
        return Tally._make(figures)  # by name it takes three times as long

    def truth(self, tally: Tally) -> Truth:
        """Everything about the step just ended, for the recorder. Call once a step, or never."""
        bodies = []
        for agent, (x_m, y_m) in enumerate(self.environment.positions_m.tolist()):
            role, level, parent = self._standings.get(agent, FREE)
            if agent not in self.lockstep.alive:
                role = "dead"
            bodies.append(Body(agent, x_m, y_m, role, level, parent))
        shown = {happening.event: happening for happening in self.environment.active}
        shown |= {happening.event: happening for happening in self.environment.take_changed()}
        events = tuple(_as_state(shown[event]) for event in sorted(shown))
        return Truth(self._step, self._time_s, tuple(bodies), events, tuple(self._links), tally)

    def watch(self, sender: int, receiver: int) -> None:
        """From the next step on, trace the frames of one agent at another for `explain`."""
        self._air = TracedAir(self._air, sender, receiver)

    def explain(self) -> tuple[list[Finding], list[str]]:
        """What each model of the air says of the watched link in this step, and what became of its frames."""
        assert isinstance(self._air, TracedAir)
        # What is heard now was sent in the step before.
        return self._air.explain(self._speaking), self._air.outcomes_of(self._links)

    def watch_uplink(self, sender: int) -> None:
        """From the next step on, trace one agent's reports for `explain_uplink`."""
        assert self._uplink is not None
        self._uplink = TracedUplink(self._uplink, sender)

    def explain_uplink(self) -> tuple[list[Finding], list[str]]:
        """What each model of the uplink says of the watched agent in this step, and what became of its reports."""
        assert isinstance(self._uplink, TracedUplink)
        return self._uplink.explain(), list(self._uplink.outcomes)

    def mean_waiting_s(self) -> float:
        """Mean waiting time so far, of the events that were sensed [s]; 0 before the first."""
        waits = [h.sensed_s - h.arrived_s for h in self.environment.happenings if h.sensed_s is not None]
        return sum(waits) / len(waits) if waits else 0.0

    def events(self) -> list[EventState]:
        """All events so far, by id."""
        return [_as_state(happening) for happening in self.environment.happenings]

    def totals(self, complete: bool) -> dict[str, Any]:
        """What the world says of a run besides its rows."""
        return {
            "complete": complete,
            "digest": self.digest.hex(),
            "agents_lost": list(self.lockstep.lost),
            "boards": {str(agent): asdict(attendance) for agent, attendance in self.lockstep.boards.items()},
            "faults": list(self._faults.log) if self._faults else [],
            "rejected": by_agent(self.rejected),
            "transport_lost": by_agent(self._radio_numbers.lost + self._report_numbers.lost),
            "fell_back": by_agent(self._radio_numbers.fell_back + self._report_numbers.fell_back),
            "refused_claims": self.refused_claims,
        }


def _as_state(happening: Happening) -> EventState:
    """An event's life as it goes to the recorder and into `events.csv`."""
    return EventState(
        happening.event,
        happening.x_m,
        happening.y_m,
        happening.arrived_s,
        happening.sensed_s,
        happening.completed_s,
        happening.work_agent_s,
    )
