"""Faults in whole swarms, in one process: what each kind does to agents, and what it leaves alone."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from deltaswarm_agent.controllers.paper.states import WALKING
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.engine import Wanted
from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.messages import Frame
from deltaswarm_wire.operator_messages import Clock
from tests.support.cores import paper, swarm

BUSY = ("events.rate_hz=0.3", "run.duration_s=120")
STEPS = 120
STEPS_S = (0.5, 1.0)
"""Lengths of a step: a fault begins and ends at its times with either."""


def timeline(*faults: str) -> str:
    return f"fault=[{', '.join('{' + fault + '}' for fault in faults)}]"


class Watched:
    """A swarm under a timeline, of which each step's frames are kept."""

    def __init__(self, *faults: str, sets: tuple[str, ...] = BUSY) -> None:
        self.crew = swarm("smoke", *sets, "run.ask_every_step=true", timeline(*faults))
        self.frames: dict[int, Frame] = {}
        begin = self.crew.world.begin

        def kept(step: int, last: bool) -> list[tuple[int, Frame]]:
            self.frames = dict(begin(step, last))
            return [*self.frames.items()]

        self.crew.world.begin = kept  # type: ignore[method-assign]

    def play(
        self, steps: int = STEPS, then: Callable[[int, StepRecord], object] = lambda step, record: None
    ) -> InProcess:
        """Run from the first step; `then` may look at each when it is over."""
        for step in range(steps):
            then(step, self.crew.step(step, step == steps - 1))
        return self.crew


def summary(*faults: str, sets: tuple[str, ...] = BUSY) -> dict[str, Any]:
    scenario = load_scenario("smoke", [*sets, timeline(*faults)])
    return summarise(run_in_process(scenario), scenario)


def test_the_killed_are_no_accident() -> None:
    """They are named among the faults, not among the lost; the run is valid, and the same again."""
    kill = 'kind="kill", at_s=40, fraction=0.5'
    found = summary(kill)
    (entry,) = found["faults"]
    assert (entry["kind"], entry["at_s"], len(entry["agents"])) == ("kill", 40.0, 3)
    assert found["agents_lost"] == []
    assert found["agents_late"] == 0
    assert found["valid"]
    assert found["frames_dropped"]["dead"] > 0
    assert found["digest"] == summary(kill)["digest"]


def test_without_faults_there_is_nothing_to_see() -> None:
    """A fault that hits nobody changes nothing."""
    plain_run, nobody = summary(), summary('kind="kill", at_s=40, fraction=0.0')
    assert plain_run["faults"] == []
    assert nobody["faults"][0]["agents"] == []
    assert plain_run["digest"] == nobody["digest"]


def test_roots_are_hit_as_the_world_hears_of_them() -> None:
    """Whoever was a root in the step before, and nobody else."""
    watched = Watched('kind="kill", at_s=60, roots=true', sets=(*BUSY, "control.delta=1"))
    roots: dict[int, list[int]] = {}

    def note(step: int, record: StepRecord) -> None:
        bodies = watched.crew.world.truth(record).bodies
        roots[step] = [body.agent for body in bodies if body.role == "root"]
        if step >= 60:
            assert {body.agent for body in bodies if body.role == "dead"} == set(roots[59])

    crew = watched.play(80, note)
    assert roots[59]
    assert crew.world.totals(True)["faults"][0]["agents"] == roots[59]


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_frozen_agent_gets_no_frame_and_goes_on_as_it_was(step_s: float) -> None:
    """It misses what was sent meanwhile, keeps its last command, and nobody waits for it."""
    watched = Watched('kind="freeze", at_s=30, duration_s=20, agents=[2]', sets=(*BUSY, f"run.step_s={step_s}"))
    velocities = set()

    def note(step: int, record: StepRecord) -> None:
        assert record.time_s == step * step_s
        assert (2 in watched.frames) == (not 30 <= record.time_s < 50)
        assert record.agents_alive == 6
        assert record.agents_late == 0
        if 30 <= record.time_s < 50:
            velocities.add(watched.crew.world.environment.velocities_mps[2])

    core = watched.crew.agents[2]
    assert watched.play(round(60 / step_s), note).agents[2] is core
    assert len(velocities) == 1


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_restarted_agent_believes_nothing(step_s: float) -> None:
    """It is a new agent with a generator of its own, in the old one's place; its counter begins anew unpunished."""
    watched = Watched(
        'kind="restart", at_s=60, fraction=1.0',
        'kind="restart", at_s=90, agents=[0], duration_s=10',
        sets=(*BUSY, f"run.step_s={step_s}"),
    )
    before = list(watched.crew.agents)
    states = []

    def note(step: int, record: StepRecord) -> None:
        assert record.transport_lost == 0
        assert record.agents_alive == (5 if 90 <= record.time_s < 100 else 6)
        states.append([paper(core).state for core in watched.crew.agents])

    crew = watched.play(round(STEPS / step_s), note)
    assert not set(map(id, before)) & set(map(id, crew.agents))
    assert any(state is not WALKING for state in states[round(60 / step_s) - 1])
    assert [core.rejected_frames + paper(core).counts["rejected_frames"] for core in crew.agents] == [0] * 6
    assert not crew.world.intake.rejected


def test_the_blind_sense_nothing_and_their_events_wait_on() -> None:
    """An event before blind agents alone is not sensed, by the world's books either."""
    found = summary('kind="sensor-blind", at_s=0, fraction=1.0')
    assert found["waiting_time_s"]["n"] == 0
    assert found["operator"]["messages"] == 0
    assert summary()["waiting_time_s"]["n"] > 5


def test_a_noisy_sensor_is_never_taken_at_its_word() -> None:
    """What the world counts is observed within true range: no claim is refused, and work gets done."""
    watched = Watched('kind="sensor-noisy", at_s=0, fraction=1.0, noise_m=1.0, miss=0.2')
    wrong = 0

    def note(step: int, record: StepRecord) -> None:
        nonlocal wrong
        scheduled = {happening.event: happening for happening in watched.crew.world.environment.arrived}
        for frame in watched.frames.values():
            for event in frame.events:
                happening = scheduled[event.event]
                assert (happening.x_m - frame.x_m) ** 2 + (happening.y_m - frame.y_m) ** 2 <= 25 + 1e-9
                wrong += event != happening.as_sensed

    crew = watched.play(STEPS, note)
    assert wrong > 100
    assert crew.world.refused_claims == 0
    assert sum(happening.work_agent_s for happening in crew.world.environment.arrived) > 0


def test_slow_actuators_slow_the_body_down() -> None:
    """At a factor of 0 it stands still, at 0.5 it goes half as fast as it wants to."""
    watched = Watched(
        'kind="actuator-slow", at_s=10, duration_s=30, agents=[1], factor=0.0',
        'kind="actuator-slow", at_s=10, agents=[2], factor=0.5',
        sets=("events.rate_hz=0.0", "run.duration_s=60"),
    )
    places = []
    watched.play(60, lambda step, record: places.append(watched.crew.world.environment.positions_m.copy()))
    moved = [((after - before) ** 2).sum(axis=1) ** 0.5 for before, after in pairwise(places)]
    still, half = [step[1] for step in moved], [step[2] for step in moved]
    assert max(still[9:39]) == 0.0
    assert max(still[:9]) > 0.9 < max(still[39:])
    assert max(half[:9]) > 0.9
    assert 0.45 < max(half[9:]) < 0.5 + 1e-9


def test_a_stuck_body_goes_straight_on_until_the_edge() -> None:
    """Also when its process is killed; afterwards it obeys again."""
    watched = Watched(
        'kind="actuator-stuck", at_s=10, duration_s=60, agents=[1, 2]',
        'kind="kill", at_s=12, agents=[2]',
        sets=("events.rate_hz=0.0", "run.duration_s=90", "control.leg_max_s=5"),
    )
    places = []
    watched.play(90, lambda step, record: places.append(watched.crew.world.environment.positions_m[1:3].copy()))
    for body in (0, 1):
        way = [(x_m, y_m) for x_m, y_m in (place[body].tolist() for place in places)]
        strides = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(way)]
        free = [all(0.0 < x_m < 40.0 for x_m in place) for place in way]
        for step in range(10, 69):
            if free[step + 1]:
                assert strides[step] == pytest.approx(strides[9], abs=1e-9)
        assert (len(set(strides[70:])) > 2) == (body == 0)


def test_a_dead_radio_neither_sends_nor_hears() -> None:
    """All that it says is dropped as dead, for each receiver, and all frames are accounted for."""
    watched = Watched('kind="radio-dead", at_s=40, duration_s=40, agents=[0, 3]', sets=(*BUSY, "radio.loss=0.1"))
    world = watched.crew.world
    last: list[StepRecord] = []
    dead = 0

    def note(step: int, record: StepRecord) -> None:
        nonlocal dead
        links = world.truth(record).links
        if 41 <= step < 80:
            assert not {0, 3} & {agent for link in links for agent in link}
        if last:
            sent = last[0].frames_sent * 5
            assert sent == record.frames_received + sum(record.frames_dropped.values())
        dead += record.frames_dropped["dead"]
        assert (record.frames_dropped["dead"] > 0) <= (40 <= step <= 80)
        last[:] = [record]

    watched.play(100, note)
    assert dead > 50


@pytest.mark.parametrize("mode", ["decentralised", "hybrid"])
def test_a_liar_tells_of_what_is_not_there(mode: str) -> None:
    """The operator and the neighbours hear of phantoms; neither work nor waiting comes of them."""
    watched = Watched(
        'kind="lying", at_s=10, agents=[3], phantoms=3',
        sets=("events.rate_hz=0.0", f"control.mode={mode}", "run.duration_s=120"),
    )
    told: set[int] = set()
    crew = watched.crew

    def note(step: int, record: StepRecord) -> None:
        assert record.events_open == 0
        crew.operator.close_step(Clock(step, record.time_s, False), 0)
        told.update(event.event for event in watched.frames[3].events)
        assert not any(frame.events for agent, frame in watched.frames.items() if agent != 3)

    watched.play(STEPS, note)
    workload = crew.operator.totals["per_sender"]
    assert workload["3"]["messages"] > 80
    assert crew.world.refused_claims == 0
    assert not crew.world.environment.arrived
    assert len(told) >= 3


def test_faults_stand_in_the_log_of_the_recording(tmp_path: Any) -> None:
    """A line for each that begins and each that ends."""
    scenario = load_scenario(
        "smoke", ["run.duration_s=30", timeline('kind="radio-dead", at_s=5, duration_s=5, agents=[1]')]
    )
    lines = []
    with Recorder(tmp_path, scenario) as recorder:
        log = recorder.log

        def kept(level: int, name: str, text: str, time_s: float) -> None:
            lines.append((time_s, text))
            log(level, name, text, time_s)

        recorder.log = kept  # type: ignore[method-assign]
        run_in_process(scenario, Wanted(recorder))
        recorder.complete({})
    assert [(time_s, "radio-dead" in text and "agent 1" in text) for time_s, text in lines] == [
        (5.0, True),
        (10.0, True),
    ]
