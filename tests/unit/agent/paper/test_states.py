"""The states of an agent: the table, its diagram, and that swarms use all of it and nothing else."""

import random
import re
from collections import Counter
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.frames import decode, encoded
from deltaswarm_agent.controllers.paper.states import FREE, TRANSITIONS, Cause, State, diagram
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_wire.envelope import decode_sample
from tests.support.cores import controllers_of, play, swarm

PAGE = Path(__file__).parents[4] / "agent/deltaswarm_agent/controllers/paper/STATES.md"

Step = tuple[State, Cause, State]

ROUGH = (
    "arena.width_m=60",
    "arena.height_m=60",
    "events.density.mean_m=[30,30]",
    "events.work_agent_s=60",
    "events.rate_hz=0.1",
    "agents.count=12",
    "radio.loss=0.6",
    "control.delta=2",
    "control.recruitment_interval_s=13",
)
"""A small arena, a busy swarm, an air that loses most of what is said."""

SEEDS = (29, 33, *range(1, 28))
"""The first two show nearly all; more are taken until all is seen."""

READINGS = (
    ("control.patience_finds=0.05",),
    ("control.idle_root=leaves", "control.root_succession=true", "control.mode=hierarchical", "control.rho=2"),
    (),
)
"""Options, of which each allows other ways in the table."""

ROUGH_STEPS, KILL_EVERY_STEPS, RECALL_EVERY_S = 1500, 100, 50

PAIR = (
    "arena.width_m=12",
    "arena.height_m=12",
    "agents.count=2",
    "agents.sensing_range_m=20",
    "radio.range_m=20",
    "radio.latency_s=2",
    "control.mode=hierarchical",
    "control.rho=1",
    "control.d_min_m=0",
    "events.rate_hz=2",
    "events.work_agent_s=10000",
    "events.density.kind=uniform",
    'fault=[{kind="restart", agents=[0], at_s=33}]',
)
CONNECTED = {0: {0}, 20: set(), 23: {1}, 30: set(), 32: {0}, 33: {0, 1}}
"""Two agents, and who of them has a link, by the step from which that holds."""


class Watch:
    def __init__(self) -> None:
        self.steps: Counter[Step] = Counter()
        self.newest: dict[Agent, State] = {}

    def install(self, patch: pytest.MonkeyPatch) -> None:
        """Look over the shoulder of every agent."""
        change = Agent.change

        def noted(agent: Agent, cause: Cause) -> None:
            before = agent.state
            change(agent, cause)
            self.steps[before, cause, agent.state] += 1
            self.newest[agent] = agent.state

        patch.setattr(Agent, "change", noted)

    def check(self, swarm: InProcess) -> None:
        """No agent has changed its state by any other way."""
        for number, controller in controllers_of(swarm).items():
            agent = controller.agent
            assert agent.state is self.newest.get(agent, State.WALKING), (swarm.scenario.seed, number)
            assert (agent.state in FREE) == (agent.membership is None), (swarm.scenario.seed, number)


def rough(seed: int, watch: Watch, *more: str) -> None:
    """A rough run, in which a member of a tree is killed now and then."""
    rng = random.Random(seed)
    crew = swarm("smoke", *ROUGH, *more, seed=seed)
    participants = crew.world.participants

    def before(step: int) -> None:
        if step and step % KILL_EVERY_STEPS == 0 and len(participants.present) > 4:
            in_trees = [n for n, one in controllers_of(crew).items() if one.membership and n in participants.present]
            if in_trees:
                participants.token_gone(rng.choice(in_trees))

    for _ in play(crew, ROUGH_STEPS, before):
        watch.check(crew)


def two_roots(watch: Watch) -> None:
    """A root begins anew while its frames are under way: the other yields to the old one, and it to the other."""
    crew = swarm("smoke", *PAIR)
    participants = crew.world.participants

    def before(step: int) -> None:
        for agent in range(2) if step in CONNECTED else ():
            (participants.token_back if agent in CONNECTED[step] else participants.token_gone)(agent)

    for _ in play(crew, 60, before):
        watch.check(crew)


def recalled(watch: Watch) -> None:
    """A rough run, in which the operator recalls all trees again and again."""
    orders = [
        f'{{at_s={at_s}, name="recall", target="tree", numbers=[{root}], arguments={{pause_s=0}}}}'
        for at_s in range(100, ROUGH_STEPS, RECALL_EVERY_S)
        for root in range(12)
    ]
    ordered(orders, watch)


def taken_off(watch: Watch) -> None:
    """A rough run, in which the operator takes all agents off their work, and back to it, again and again."""
    ordered(
        [
            f'{{at_s={at_s}, name="set structure", arguments={{delta=9, working={at_s // RECALL_EVERY_S % 2}}}}}'
            for at_s in range(100, ROUGH_STEPS, RECALL_EVERY_S)
        ],
        watch,
    )


def ordered(orders: list[str], watch: Watch) -> None:
    crew = swarm("smoke", *ROUGH, f"command=[{', '.join(orders)}]", seed=1)
    for _ in crew.steps(ROUGH_STEPS - 1):
        watch.check(crew)


@pytest.fixture(scope="module")
def taken() -> Iterator[dict[Step, int]]:
    """All changes of state in as many rough runs as it takes to see each, at most those of SEEDS."""
    watch = Watch()
    with pytest.MonkeyPatch.context() as patch:
        watch.install(patch)
        two_roots(watch)
        recalled(watch)
        taken_off(watch)
        for seed, reading in product(SEEDS, READINGS):
            rough(seed, watch, *reading)
            if len(watch.steps) >= len(TRANSITIONS):
                break
        yield watch.steps


def test_the_page_shows_the_table() -> None:
    """The diagram in STATES.md is the one that is drawn from the code's table."""
    (block,) = re.findall(r"^```mermaid\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert block == diagram()


def test_every_state_can_be_left_for_walking() -> None:
    """No state is a trap: from each the table leads back to a free agent."""
    free, known = {State.WALKING}, set[State]()
    while free != known:
        known = set(free)
        free |= {source for (source, _), to in TRANSITIONS.items() if to in known}
    assert free == set(State)


def test_every_cause_is_in_the_table() -> None:
    assert {cause for _, cause in TRANSITIONS} == set(Cause)


def test_swarms_take_every_transition(taken: dict[Step, int]) -> None:
    """Each way in the table does occur, with loss, kills and links that break."""
    seen = {(source, cause) for source, cause, _ in taken}
    missing = [f"{source.value}: {cause.value}" for source, cause in TRANSITIONS if (source, cause) not in seen]
    assert not missing, f"not seen with seeds {SEEDS}: {missing}"


def test_swarms_take_no_other_transition(taken: dict[Step, int]) -> None:
    assert {(source, cause): to for source, cause, to in taken}.items() <= TRANSITIONS.items()
    assert len({(source, cause) for source, cause, _ in taken}) == len(taken)


def test_what_a_rough_swarm_says_is_always_valid() -> None:
    """Whatever state an agent is in, each of its frames decodes to itself: no path names an agent twice."""
    for seed in (1, 2):
        crew = swarm("smoke", *ROUGH, seed=seed)
        for step in range(400):
            crew.step(step, last=False)
            for agent, data in crew.world.intake.transmitted.items():
                payload = decode_sample(data).payload
                made = decode(agent, payload)
                encoded.clear()  # else nothing would be decoded
                assert decode(agent, payload) == made, (seed, step, agent)
