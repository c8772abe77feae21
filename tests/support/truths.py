"""For the recorder's tests: plausible truths, recordings of them, and what a viewer reads in those."""

import random
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from deltaswarm_orchestrator.recording import RECORDING
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import COLUMNS, DEAD, AgentState, EventState, StepRecord, Truth
from deltaswarm_wire.messages import NOBODY, Event
from deltaswarm_wire.operator_messages import Report, Workload

ROLES = ("free", "attending", "root", "member", "orphan", "relocating", "leaving", DEAD)
IN_TREE = frozenset({"root", "member", "orphan", "relocating"})


def steps(
    scenario: Scenario, count: int, seed: int = 1, links: int = 75, reports: int = 4
) -> Iterator[tuple[Truth, tuple[Report, ...], Workload]]:
    """`count` steps of a swarm: the truth, what reached the operator, and what the operator counted."""
    rng = random.Random(seed)
    width_m, height_m, step_s = scenario.arena.width_m, scenario.arena.height_m, scenario.run.step_s
    agents = scenario.agents.count
    places = [(rng.uniform(0, width_m), rng.uniform(0, height_m)) for _ in range(agents)]
    roles = [ROLES[i % len(ROLES)] for i in range(agents)]
    active: dict[int, EventState] = {}
    arrived = 0
    for step in range(count):
        time_s = step * step_s
        places = [(_near(rng, x, width_m), _near(rng, y, height_m)) for x, y in places]
        shown = dict(active)
        while len(active) < 12:
            arrived += 1
            shown[arrived] = active[arrived] = EventState(
                arrived, rng.uniform(0, width_m), rng.uniform(0, height_m), time_s, None, None, None, 0.0
            )
        for event in rng.sample(sorted(active), 6):
            shown[event] = active[event] = _worked_on(rng, active[event], time_s)
        active = {event: state for event, state in active.items() if state.completed_s is None}
        bodies = tuple(_body(agent, places[agent], roles) for agent in range(agents))
        truth = Truth(
            step,
            time_s,
            bodies,
            tuple(shown[event] for event in sorted(shown)),
            tuple((rng.randrange(agents), rng.randrange(agents)) for _ in range(links)),
            _step_record(rng, step, time_s, len(active)),
        )
        sent = tuple(_report(rng, agent, step, places[agent], truth.events) for agent in range(min(agents, reports)))
        yield truth, sent, _workload(rng, step, time_s, len(sent))


def _near(rng: random.Random, value: float, limit: float) -> float:
    return min(limit, max(0.0, value + rng.uniform(-1, 1)))


def _worked_on(rng: random.Random, event: EventState, time_s: float) -> EventState:
    sensed_s = time_s if event.sensed_s is None else event.sensed_s
    work_agent_s = event.work_agent_s + rng.uniform(0, 20)
    return event._replace(
        sensed_s=sensed_s,
        worked_s=time_s if event.worked_s is None else event.worked_s,
        completed_s=time_s if work_agent_s >= 200 else None,
        work_agent_s=work_agent_s,
    )


def _body(agent: int, place: tuple[float, float], roles: list[str]) -> AgentState:
    role = roles[agent]
    in_tree = role in IN_TREE and role != "root"
    root = roles.index("root") if role in IN_TREE and "root" in roles else NOBODY
    return AgentState(agent, *place, role, int(in_tree), root if in_tree else NOBODY, root)


def _step_record(rng: random.Random, step: int, time_s: float, events_open: int) -> StepRecord:
    area_m2 = rng.uniform(0, 700) if step % 10 == 0 else None
    counts = {name: rng.randrange(30) for name in COLUMNS}
    counts |= {"step": step, "agents_alive": 25, "agents_late": rng.randrange(2), "agents_in_trees": 12, "trees": 3}
    return StepRecord.of({**counts, "time_s": time_s, "covered_area_m2": area_m2, "events_open": events_open})


def _report(
    rng: random.Random, agent: int, step: int, place: tuple[float, float], events: tuple[EventState, ...]
) -> Report:
    known = tuple(Event(event.event, event.x_m, event.y_m) for event in events[: rng.randrange(1, 4)])
    return Report(agent, step, step, rng.choice(("attending", "root")), *place, rng.randrange(8), known)


def _workload(rng: random.Random, step: int, time_s: float, messages: int) -> Workload:
    return Workload(step, time_s, messages, messages, messages / 3, rng.uniform(0, 10), time_s / 7, 0, 0, 0)


def recorded(folder: Path, scenario: Scenario, count: int) -> Path:
    """The file of a recording of `count` plausible steps, with a line of log in each."""
    with Recorder(folder, scenario, wall=lambda: 0.0) as recorder:
        for truth, reports, workload in steps(scenario, count):
            recorder.step(truth, reports)
            recorder.workload(workload)
            recorder.log(20, "world", f"step {truth.step}", truth.time_s)
        recorder.complete({"exit": "completed"})
    return folder / RECORDING


def messages(path: Path) -> list[tuple[str, int, Any]]:
    """Topic, log time [ns] and decoded message, as a viewer reads them: through the index, in time order."""
    with path.open("rb") as stream:
        found = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        return [(channel.topic, message.log_time, decoded) for _, channel, message, decoded in found]


def on(topic: str, found: Iterable[tuple[str, int, Any]]) -> list[Any]:
    return [message for one, _, message in found if one == topic]


def truth(*bodies: AgentState, events: tuple[EventState, ...] = (), links: tuple[tuple[int, int], ...] = ()) -> Truth:
    zeros: dict[str, Any] = dict.fromkeys(COLUMNS, 0)
    return Truth(0, 0.0, bodies, events, links, StepRecord.of({**zeros, "time_s": 0.0, "covered_area_m2": None}))


def shown(folder: Path, *truths: Truth) -> list[tuple[str, int, Any]]:
    """What is recorded of a few truths."""
    with Recorder(folder, Scenario()) as recorder:
        for one in truths:
            recorder.step(one, ())
        recorder.complete({})
    return messages(folder / "recording.mcap")
