"""The agent: a pure function of its state and the frame of this step.

It knows its own settings, its own sensor and the radio frames that reached it. Each step takes one
`Frame` and gives one `Decision`: an act, at most one radio frame, at most one report.
"""

from collections.abc import Callable, Sequence
from random import Random
from typing import NamedTuple

from deltaswarm_agent.beliefs import GONE_MARGIN_M, Beliefs, to_cm
from deltaswarm_agent.hearing import Ear, Whereabouts
from deltaswarm_agent.motion import STAND, Velocity, Walk, towards
from deltaswarm_agent.recruitment import Place, Recruiter
from deltaswarm_agent.states import ATTENDING, GOING, MEMBER, ORPHAN, RELOCATING, ROOT, TRANSITIONS, WALKING, Cause
from deltaswarm_agent.strategies import strategy_of
from deltaswarm_agent.tree import (
    ARRIVAL_STEPS,
    ARRIVAL_STRICT_STEPS,
    LEAVING_STEPS,
    ORPHAN_STEPS,
    ORPHAN_STRICT_STEPS,
    SILENCE_STEPS,
    STALL_STEPS,
    Former,
    Membership,
    fits_below,
)
from deltaswarm_wire.messages import MAX_REPORTED, Act, Event, Frame, Report
from deltaswarm_wire.radio import Attending, Leaving, Member, Order, RadioFrame, Relocating, decode_radio
from deltaswarm_wire.settings import AgentSettings

AT_PLACE_M = 0.01
"""This close to a place is on it."""


class Decision(NamedTuple):
    """What an agent sends in one step; the act closes it."""

    act: Act
    radio: RadioFrame | None
    report: Report | None


def agent_rng(seed: int, agent: int, restart: int = 0) -> Random:
    """The agent's own generator; the same for the same seed and number of its restart on any machine."""
    return Random(f"deltaswarm/{seed}/agent/{agent}" + (f"/restart/{restart}" if restart else ""))


class AgentCore:
    """One agent. `step` is its one mutating method; the generator and the decoder are handed in."""

    def __init__(
        self,
        agent: int,
        settings: AgentSettings,
        rng: Random,
        decode: Callable[[bytes], RadioFrame] = decode_radio,
    ) -> None:
        self.agent = agent
        self.settings = settings
        self.state = WALKING
        self.membership: Membership | None = None

        control = settings.control
        self._strategy = strategy_of(control)
        self._ear = Ear(agent, decode)
        self._here = Whereabouts(settings)
        self._walk = Walk(settings, rng)
        self._beliefs = Beliefs(settings.sensing_range_m)
        self._recruiter = Recruiter(settings, rng)
        self._recruit_every = max(1, round(control.recruitment_interval_s / settings.step_s))
        self._target: Event | None = None
        self._place: Place = (0.0, 0.0)
        self._since = 0
        self._farewells = 0
        self._former: Former | None = None
        self._order: Order | None = None
        self._last_order = (-1, -1)
        self._now = 0
        self._counter = 0
        self._sequence = 0

    @property
    def rejected_frames(self) -> int:
        """Frames heard that broke the protocol."""
        return self._ear.rejected

    def step(self, frame: Frame) -> Decision:
        """Decide. Frames come in order of their steps; steps may be missing between them."""
        self._now = frame.step
        self._here.move_to(frame.x_m, frame.y_m)
        heard = self._ear.newest_of(frame.heard, frame.step) if frame.heard else []
        if self.membership is None:
            self._step_free(frame.events, heard)
        else:
            self._step_in_tree(self.membership, frame.events, heard)
        decision = self._decision(frame)
        self._here.keep()
        return decision

    # Free agents

    def _step_free(self, sensed: Sequence[Event], heard: list[RadioFrame]) -> None:
        members = [frame for frame in heard if type(frame) is Member] if heard else []
        threshold = self._strategy.founds_at
        if threshold is not None and len(sensed) >= threshold and not members:
            self._step_in_tree(self._enter_tree(None, Cause.THRESHOLD_REACHED), sensed, heard)
            return
        parent = self._parent_to_join(members) if members else None
        if parent is not None:
            self._step_in_tree(self._enter_tree(parent, Cause.MEMBER_MET), sensed, heard)
        elif self._strategy.attends:
            self._seek_event(sensed, heard)

    def _parent_to_join(self, members: Sequence[Member]) -> Member | None:
        """Tree Growth: the nearest member newly in range and at least d_min away."""
        candidates = [
            frame
            for frame in members
            if not frame.orphan
            and self._here.is_legal(frame)
            and self._here.is_newly_met(frame)
            and fits_below(self.agent, frame)
            and (self._former is None or self._former.trusts(frame, self._now))
        ]
        return self._nearest(candidates)

    def _nearest(self, candidates: Sequence[Member]) -> Member | None:
        if not candidates:
            return None
        return min(candidates, key=self._sender_distance)

    def _sender_distance(self, frame: RadioFrame) -> tuple[float, int]:
        return self._here.sender_m2(frame), frame.sender

    def _seek_event(self, sensed: Sequence[Event], heard: Sequence[RadioFrame]) -> None:
        """Baseline coordination algorithm: go to an event, observe it until it is complete."""
        target = self._target
        if self.state is ATTENDING and target is not None:
            if any(event.event == target.event for event in sensed):
                return
            self._change(Cause.ANOTHER_SENSED if sensed else Cause.EVENT_COMPLETE)
        if sensed:
            self._target = min(sensed, key=self._event_distance)
            if self.state is WALKING:
                self._change(Cause.EVENT_SENSED)
        elif self.state is GOING and target is not None:
            if self._event_distance(target)[0] < (self.settings.sensing_range_m - GONE_MARGIN_M) ** 2:
                self._change(Cause.EVENT_NOT_THERE)
        elif heard and self.state is WALKING:
            self._join_attending(heard)
        if self.state is GOING and self._is_at_sensed_event(sensed):
            self._change(Cause.AT_THE_EVENT)

    def _is_at_sensed_event(self, sensed: Sequence[Event]) -> bool:
        target = self._target
        return bool(sensed) and target is not None and self._event_distance(target)[0] <= AT_PLACE_M**2

    def _event_distance(self, event: Event) -> tuple[float, int]:
        return self._here.distance_m2(event.x_m, event.y_m), event.event

    def _join_attending(self, heard: Sequence[RadioFrame]) -> None:
        """A walking agent that comes newly into range of an attending one goes to its event too."""
        attending = [
            frame
            for frame in heard
            if type(frame) is Attending
            and self._here.is_newly_met(frame)
            and self._here.is_in_arena(frame.event_x_cm / 100, frame.event_y_cm / 100)
        ]
        if attending:
            near = min(attending, key=self._sender_distance)
            self._target = Event(near.event, near.event_x_cm / 100, near.event_y_cm / 100)
            self._change(Cause.NEIGHBOUR_ATTENDS)

    # Agents in trees

    def _enter_tree(self, parent: Member | None, cause: Cause) -> Membership:
        self._change(cause)
        self.membership = Membership(self.agent, parent, self.settings.control.gamma_max, self._now)
        self._target = None
        self._order = None
        self._recruiter.forget_movers()
        self._farewells = 0
        return self.membership

    def _leave_tree(self, cause: Cause) -> None:
        """Become free, and the whole subtree with it: children hear of it and leave too."""
        assert self.membership is not None
        self._former = self.membership.former(self._now)
        self.membership = None
        self._farewells = LEAVING_STEPS
        self._change(cause)

    def _step_in_tree(self, membership: Membership, sensed: Sequence[Event], heard: list[RadioFrame]) -> None:
        now, root, beliefs = self._now, membership.root, self._beliefs
        carried, self._order = self._order, None
        membership.hear_children(heard, now)
        for frame in heard:
            if type(frame) is Member and frame.path[0] == root:
                beliefs.hear(frame.events, frame.gone, now)
        beliefs.sense(sensed, self._here.x_m, self._here.y_m, now)
        beliefs.forget(now)
        if self.state is ROOT:
            self._step_root(membership, heard, carried)
        elif self.state is MEMBER:
            self._step_member(membership, sensed, heard)
        elif self.state is ORPHAN:
            self._find_parent(membership, heard, ORPHAN_STRICT_STEPS, ORPHAN_STEPS)
        elif self._has_arrived():
            self._find_parent(membership, heard, ARRIVAL_STRICT_STEPS, ARRIVAL_STEPS)
        else:
            self._since = self._now + 1

    def _step_root(self, membership: Membership, heard: Sequence[RadioFrame], carried: Order | None) -> None:
        rivals = [frame for frame in heard if type(frame) is Member and len(frame.path) == 1]
        senior = membership.senior_of(rivals) if rivals else None
        membership.beat(self._now)
        if senior is not None:
            if self._here.is_apart(senior) and membership.follow(senior, self._now):
                self._change(Cause.SENIOR_ROOT)
            else:
                self._leave_tree(Cause.SENIOR_TOO_CLOSE)
        elif self.settings.control.recruitment and membership.pulse % self._recruit_every == 0:
            here = (self._here.x_m, self._here.y_m)
            self._order = self._recruiter.order(membership.table(), here, self._beliefs.active(), self._now)
        elif carried is not None and carried.ttl > 1:
            self._order = carried._replace(ttl=carried.ttl - 1)

    def _step_member(self, membership: Membership, sensed: Sequence[Event], heard: Sequence[RadioFrame]) -> None:
        parent = membership.parent
        for frame in heard:
            if frame.sender == parent and self._hear_parent(membership, frame):
                return
        if self._now - membership.parent_heard >= SILENCE_STEPS:
            self._become_orphan(Cause.PARENT_LOST)
        elif self._now - membership.pulse_step >= STALL_STEPS:
            self._leave_tree(Cause.PULSE_STALLED)
        elif sensed or not self.settings.control.dissolution:
            membership.gamma = self.settings.control.gamma_max
        else:
            membership.gamma -= membership.level
            if membership.gamma <= 0:
                self._leave_tree(Cause.DISSOLVED)

    def _hear_parent(self, membership: Membership, frame: RadioFrame) -> bool:
        """Follow the parent's frame; True if that ends this agent's membership as it was."""
        if type(frame) is Leaving:
            self._leave_tree(Cause.PARENT_LEFT)
        elif type(frame) is not Member:
            self._become_orphan(Cause.PARENT_LOST)
        elif not membership.follow(frame, self._now):
            self._become_orphan(Cause.CYCLE_FOUND)
        elif frame.order is not None:
            return self._hear_order(membership, frame.order)
        else:
            return False
        return True

    def _hear_order(self, membership: Membership, order: Order) -> bool:
        """Carry out an order, or pass it on to the branch that has its leaf; True if this agent goes."""
        if order.leaf != self.agent:
            if order.ttl > 1 and any(row.agent == order.leaf for row in membership.table()):
                self._order = order._replace(ttl=order.ttl - 1)
            return False
        number = (membership.root, order.number)
        place = (order.x_cm / 100, order.y_cm / 100)
        if membership.children or number == self._last_order or not self._here.is_in_arena(*place):
            return False
        self._last_order = number
        self._place = place
        self._since = self._now + 1
        self._change(Cause.ORDERED)
        return True

    def _become_orphan(self, cause: Cause) -> None:
        self._change(cause)
        self._since = self._now

    def _has_arrived(self) -> bool:
        return self._here.distance_m2(*self._place) <= AT_PLACE_M**2

    def _find_parent(self, membership: Membership, heard: Sequence[RadioFrame], strict_steps: int, steps: int) -> None:
        """An orphan, or a mover at its place, looks for a parent in its own tree; at last it gives up."""
        waited = self._now - self._since
        fitting = self._here.is_legal if waited < strict_steps else self._here.is_within_reach
        parent = self._nearest(
            [f for f in heard if type(f) is Member and fitting(f) and membership.adopts(f, self._now)]
        )
        if parent is not None and membership.follow(parent, self._now):
            membership.gamma = self.settings.control.gamma_max
            self._change(Cause.ADOPTED)
        elif waited >= steps:
            self._leave_tree(Cause.NOBODY_FOUND)

    # Speaking

    def _change(self, cause: Cause) -> None:
        """The one place where the state changes: along the table."""
        self.state = TRANSITIONS[self.state, cause]
        if self.state is WALKING:
            self._target = None
            self._walk.turn()

    def _decision(self, frame: Frame) -> Decision:
        vx_mps, vy_mps = self._velocity()
        observed = self._observed(frame.events) if frame.events else ()
        radio = self._radio(len(frame.events))
        if radio is not None:
            self._counter += 1
        report = self._report(frame, radio)
        if report is not None:
            self._sequence += 1
        return Decision(Act(frame.step, vx_mps, vy_mps, observed), radio, report)

    def _velocity(self) -> Velocity:
        if self.state is WALKING:
            return self._walk.velocity(self._here.x_m, self._here.y_m)
        if self.state is GOING and self._target is not None:
            return towards(self._here.x_m, self._here.y_m, self._target.x_m, self._target.y_m, self.settings)
        if self.state is RELOCATING:
            return towards(self._here.x_m, self._here.y_m, *self._place, self.settings)
        return STAND

    def _observed(self, sensed: Sequence[Event]) -> tuple[int, ...]:
        """The events that this agent works on in this step."""
        if self.state in (WALKING, GOING, RELOCATING):
            return ()
        if self.state is ATTENDING:
            assert self._target is not None
            return (self._target.event,)
        if self.settings.control.member_observes == "all":
            return tuple(event.event for event in sensed)
        return (min(sensed, key=self._event_distance).event,)

    def _radio(self, score: int) -> RadioFrame | None:
        """What the neighbours are told; who has nothing to say is silent."""
        attends = self.state is ATTENDING
        if self.membership is None and not attends and self._farewells == 0:
            return None
        head = (self.agent, self._counter, to_cm(self._here.x_m), to_cm(self._here.y_m))
        if self.state is RELOCATING:
            return Relocating(*head)
        if self.membership is not None:
            return Member(
                *head,
                self.state is ORPHAN,
                self.membership.path,
                self.membership.pulse,
                score,
                self.membership.table(),
                self._beliefs.sightings(self._now),
                self._beliefs.departures(self._now),
                self._order,
            )
        if self._farewells > 0:
            self._farewells -= 1
            return Leaving(*head)
        target = self._target
        assert target is not None
        return Attending(*head, target.event, to_cm(target.x_m), to_cm(target.y_m))

    def _report(self, frame: Frame, radio: RadioFrame | None) -> Report | None:
        """What the operator is told: by an attending agent its event, by a root what its tree knows."""
        events: tuple[Event, ...]
        if self.state is ATTENDING and self._target is not None:
            role, followers, events = "attending", 0, (self._target,)
        elif self.state is ROOT and self._beliefs and type(radio) is Member:
            role, followers, events = "root", len(radio.table), tuple(self._beliefs.active()[:MAX_REPORTED])
        else:
            return None
        return Report(self.agent, self._sequence, frame.step, role, frame.x_m, frame.y_m, followers, events)
