"""Cores for tests: one agent driven by hand, and whole swarms in one process."""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

from hypothesis import strategies as st

from deltaswarm_agent.controller import make_controller
from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.frames import (
    Attending,
    Descendant,
    Gone,
    Leaving,
    Member,
    PaperFrame,
    RecruitmentOrder,
    Relocating,
    Sighting,
    decode,
    encode,
)
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_agent.controllers.paper.timers import timers
from deltaswarm_agent.core.agent_core import AgentCore
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.checked import load
from deltaswarm_wire.envelope import Sample, decode_sample, encode_sample
from deltaswarm_wire.messages import Act, Event, Frame, Heard, Pose
from deltaswarm_wire.operator_messages import Report
from deltaswarm_wire.settings import AgentSettings
from tests.support import strategies

Place = tuple[float, float]

ME, PARENT, ROOT = 7, 3, 1
"""The hand-driven agent, and two of its neighbours."""

STEPS = timers(1.0)
"""The protocol's timers for steps of 1 s."""


def cm(metres: float) -> int:
    return round(100 * metres)


def event(number: int, x_m: float, y_m: float) -> Event:
    return Event(number, float(x_m), float(y_m))


def attending(sender: int, at: Place, number: int, event_at: Place) -> Attending:
    return Attending(sender, cm(at[0]), cm(at[1]), number, cm(event_at[0]), cm(event_at[1]))


def member(
    path: Sequence[int],
    at: Place,
    *,
    pulse: int = 0,
    orphan: bool = False,
    score: int = 0,
    table: Iterable[Descendant] = (),
    events: Iterable[Sighting] = (),
    gone: Iterable[Gone] = (),
    order: RecruitmentOrder | None = None,
) -> Member:
    head = (path[-1], cm(at[0]), cm(at[1]))
    return Member(*head, orphan, tuple(path), pulse, score, tuple(table), tuple(events), tuple(gone), order)


def child(sender: int, parent_path: Sequence[int], at: Place, **more: Any) -> Member:
    """A child's frame, by its parent's path."""
    return member((*parent_path, sender), at, **more)


def relocating(sender: int, at: Place) -> Relocating:
    return Relocating(sender, cm(at[0]), cm(at[1]))


def leaving(sender: int, at: Place) -> Leaving:
    return Leaving(sender, cm(at[0]), cm(at[1]))


SHARED = {spec.name for spec in fields(AgentSettings)}


def agent_settings(**keys: Any) -> AgentSettings:
    """An agent's settings, by default with a radio of 10 m and gamma of 50 s; other keys are those of its control."""
    shared = {key: value for key, value in keys.items() if key in SHARED}
    control = {key: value for key, value in keys.items() if key not in SHARED}
    return load(AgentSettings, {"range_m": 10.0, **shared, "control": {"mode": "hybrid", "gamma_max": 50, **control}})


class StepAnswer(NamedTuple):
    """What an agent sends in one step, decoded."""

    act: Act
    radio: PaperFrame | None
    report: Report | None


class Core:
    """An agent under the paper's control, by itself."""

    def __init__(self, agent: int, settings: AgentSettings, restart: int = 0) -> None:
        self.agent = agent
        self.core = AgentCore(agent, settings.step_s, make_controller(agent, settings, restart))
        self.controller = paper(self.core)

    @property
    def state(self) -> State:
        """What it is doing."""
        return self.controller.state

    @property
    def membership(self) -> Membership | None:
        """Its place in a tree."""
        return self.controller.membership

    @property
    def gamma(self) -> float:
        """Its dissolution parameter."""
        return self.controller.agent.gamma

    @property
    def rejected_frames(self) -> int:
        """Frames heard that broke a protocol."""
        return self.core.rejected_frames + self.controller.counts["rejected_frames"]

    def step(self, frame: Frame) -> StepAnswer:
        """One step, as the world asks for it."""
        out = self.core.step(frame)
        return StepAnswer(out.act, opened(self.agent, out.radio), out.report)


def opened(sender: int, sample: bytes | None) -> PaperFrame | None:
    """The paper's frame in a sample, if there is one."""
    return None if sample is None else decode(sender, decode_sample(sample).payload)


def paper(core: AgentCore) -> PaperController:
    """The controller of an agent under the paper's control."""
    assert isinstance(core.controller, PaperController)
    return core.controller


def on_air(frame: PaperFrame, counter: int) -> Heard:
    """A frame as the air delivers it."""
    return frame.sender, encode_sample(Sample(counter, encode(frame)))


class Lone:
    """One core with hand-made frames. It stays where it is put, whatever it wants.

    Frames made by the helpers above get the step as their counter, so they are always the newest.
    """

    def __init__(self, agent: int = ME, at: Place = (50.0, 50.0), seed: int = 1, **control: Any) -> None:
        self.settings = replace(agent_settings(**control), seed=seed)
        self.core = Core(agent, self.settings)
        self.at = at
        self.now = -1

    def step(
        self,
        *frames: PaperFrame | Heard,
        events: Iterable[Event] = (),
        at: Place | None = None,
        skip: int = 0,
        poses: Iterable[Pose] = (),
    ) -> StepAnswer:
        """One step; `at` moves it there first, `skip` is a number of steps that it misses before."""
        self.now += 1 + skip
        self.at = at or self.at
        data = tuple(on_air(said, self.now) if isinstance(said, PaperFrame) else said for said in frames)
        time_s = self.now * self.settings.step_s
        frame = Frame(self.now, time_s, False, *self.at, tuple(poses), tuple(events), data)
        return self.core.step(frame)

    def steps(self, count: int, *heard: PaperFrame, events: Sequence[Event] = ()) -> list[StepAnswer]:
        """Several alike."""
        return [self.step(*heard, events=events) for _ in range(count)]

    def go_where_it_wants(self, *heard: PaperFrame, events: Iterable[Event] = ()) -> StepAnswer:
        """One step, after which the body has moved by the act."""
        decision = self.step(*heard, events=events)
        step_s = self.settings.step_s
        self.at = (self.at[0] + decision.act.vx_mps * step_s, self.at[1] + decision.act.vy_mps * step_s)
        return decision

    @property
    def path(self) -> tuple[int, ...]:
        """Its path; empty if it is free."""
        return self.core.membership.path if self.core.membership else ()

    @property
    def gamma(self) -> float:
        """Its dissolution parameter."""
        return self.core.gamma


PARENT_AT: Place = (50.0, 50.0)
OUTSIDE: Place = (61.0, 50.0)
INSIDE: Place = (59.0, 50.0)
"""Out of range of the parent, and newly in range of it at a legal distance."""


def a_member(path: Sequence[int] = (ROOT, PARENT), pulse: int = 100, **control: Any) -> Lone:
    """An agent that has just joined the last of `path`, which stands at PARENT_AT."""
    lone = Lone(at=OUTSIDE, **control)
    lone.step()
    lone.step(member(path, PARENT_AT, pulse=pulse), at=INSIDE)
    assert lone.path == (*path, ME)
    return lone


def a_root(at: Place = (50.0, 50.0), agent: int = ME, **control: Any) -> Lone:
    """An agent that has just founded a tree, hierarchically at one event, so that its threshold is no matter."""
    lone = Lone(agent=agent, at=at, **{"mode": "hierarchical", "rho": 1, **control})
    lone.step(events=[event(1, *at)])
    assert lone.path == (agent,)
    return lone


class Crowd:
    """Several hand-driven agents that hear one another within range, one step late."""

    def __init__(self, *lones: Lone) -> None:
        self.lones = {lone.core.agent: lone for lone in lones}
        self._said: dict[int, PaperFrame] = {}

    def step(
        self, events: dict[int, list[Event]] | None = None, silent: Collection[int] = (), deaf: Collection[int] = ()
    ) -> dict[int, StepAnswer]:
        """One step of all; what `silent` agents say is lost, and `deaf` ones hear nothing."""
        decisions = {}
        for agent, lone in self.lones.items():
            heard = [
                frame
                for sender, frame in self._said.items()
                if sender != agent and agent not in deaf and math.dist(self.lones[sender].at, lone.at) <= 10
            ]
            decisions[agent] = lone.step(*heard, events=(events or {}).get(agent, ()))
        said = {agent: decision.radio for agent, decision in decisions.items() if agent not in silent}
        self._said = {agent: radio for agent, radio in said.items() if radio is not None}
        return decisions


def a_chain(length: int, **control: Any) -> Crowd:
    """A root, agent 0 at x = 20 m, and below it agents 1, 2... each 8 m farther on and one level down."""
    control = {"mode": "hierarchical", "rho": 1, **control}
    crowd = Crowd(a_root((20.0, 50.0), 0, **control))
    for agent in range(1, length):
        x_m = 20.0 + 8 * agent
        crowd.step()
        lone = Lone(agent, (x_m + 3, 50.0), **control)
        lone.step(skip=crowd.lones[0].now)
        lone.at = (x_m, 50.0)
        crowd.lones[agent] = lone
        crowd.step()
        assert lone.path == tuple(range(agent + 1))
    return crowd


def swarm(name: str, *sets: str, seed: int = 1) -> InProcess:
    """A whole swarm in this process."""
    return InProcess(load_scenario(name, sets, seed))


def controllers_of(swarm: InProcess) -> dict[int, PaperController]:
    """The controllers of a swarm under the paper's control, by agent."""
    return {core.agent: paper(core) for core in swarm.agents}


def play(swarm: InProcess, steps: int, before: Callable[[int], object] = lambda step: None) -> Iterator[StepRecord]:
    """Run steps from 0 on; `before` each something may happen to the world."""
    for step in range(steps):
        before(step)
        yield swarm.step(step, step == steps - 1)


# Frames of neighbours: valid, few agents and places near one another, so that they matter to one another

neighbours = st.integers(0, 9)
KIN = [(ROOT,), (ROOT, PARENT), (ROOT, 8), (ROOT, PARENT, ME, 4), (ROOT, PARENT, ME, 5), (ME, 4), (ME, 5), (ME, 4, 6)]
"""Paths in the tree of `a_member`, or of `a_root`."""

pulses = st.integers(0, 60)
near_cm = st.integers(3500, 6500)
some_averages = st.none() | strategies.averages
near_events = st.builds(Event, st.integers(1, 4), st.floats(45, 55), st.floats(45, 55))


@st.composite
def near_members(draw: st.DrawFn, places_cm: st.SearchStrategy[int] = near_cm) -> Member:
    """A member's frame, with whatever its sender might claim."""
    path = draw(st.lists(neighbours, min_size=1, max_size=4, unique=True) | st.sampled_from(KIN))
    rows = st.builds(Descendant, neighbours, neighbours, places_cm, places_cm, st.integers(0, 3))
    sightings = st.builds(Sighting, st.integers(1, 4), places_cm, places_cm, st.integers(0, 40))
    orders = st.builds(RecruitmentOrder, neighbours, places_cm, places_cm, st.integers(0, 3), st.integers(0, 12))
    return Member(
        path[-1],
        draw(near_cm),
        draw(near_cm),
        draw(st.booleans()),
        tuple(path),
        draw(pulses | strategies.steps),
        draw(st.integers(0, 3)),
        draw(strategies.tuples_of(rows, 3)),
        draw(strategies.tuples_of(sightings, 3)),
        draw(strategies.tuples_of(st.builds(Gone, st.integers(1, 4), st.integers(0, 40)), 2)),
        draw(st.none() | orders),
        draw(some_averages),
    )


def near_frames(places_cm: st.SearchStrategy[int] = near_cm) -> st.SearchStrategy[PaperFrame]:
    """A frame of any kind; `places_cm` is what it says of places other than its sender's."""
    head = (neighbours, near_cm, near_cm)
    return st.one_of(
        near_members(places_cm),
        near_members(places_cm),
        st.builds(Attending, *head, st.integers(1, 4), places_cm, places_cm, some_averages),
        st.builds(Relocating, *head),
        st.builds(Leaving, *head),
    )


def lives(frames: st.SearchStrategy[Any], steps: int = 12) -> st.SearchStrategy[list[tuple[list[Any], list[Event]]]]:
    """What an agent hears and senses in some steps."""
    sensed = st.lists(near_events, max_size=3, unique_by=lambda event: event.event)
    return st.lists(st.tuples(st.lists(frames, max_size=4), sensed), min_size=1, max_size=steps)
