"""Trees in whole swarms: what message-kept trees look like beside the truth, with loss, kills and silenced roots.

An agent knows nothing of the truth; here it is compared with it. Bounds are those measured over 120 swarms,
with some slack: the longest of any agent, in steps on end.
"""

import random

import pytest

from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_world.core.air.channel.loss import Loss
from tests.support.cores import controllers_of, swarm
from tests.support.tiers import first_of, nightly
from tests.support.trees import Spans, check_agreement, cycle_of, true_descendants

STEPS, KILL_EVERY_STEPS = 600, 60

BUSY = ("events.rate_hz=0.1", "arena.width_m=70", "arena.height_m=70", "events.density.mean_m=[35, 35]")
"""The paper's swarm in half the area with twice the events: many trees soon."""


class Trees:
    def __init__(self, seed: int, *sets: str) -> None:
        self.seed = seed
        self.crew: InProcess = swarm("paper-25", *BUSY, *sets, seed=seed)
        self.rng = random.Random(seed)
        self.step = -1
        self.cycle, self.rootless, self.ghost, self.missing = Spans(), Spans(), Spans(), Spans()
        self.most_in_trees = 0

    @property
    def present(self) -> set[int]:
        return self.crew.world.participants.present

    @property
    def members(self) -> dict[int, PaperController]:
        """The living agents in trees."""
        return {n: one for n, one in controllers_of(self.crew).items() if one.membership and n in self.present}

    def kill_a_root(self) -> None:
        """Silence one, if there is any, while enough agents are left to go on."""
        roots = [agent for agent, core in self.members.items() if core.state is State.ROOT]
        if roots and len(self.present) > 12:
            self.crew.world.participants.token_gone(self.rng.choice(roots))

    def advance(self) -> None:
        """One step, and a look at all trees after it."""
        self.step += 1
        self.crew.step(self.step, last=False)
        members = self.members
        self.most_in_trees = max(self.most_in_trees, len(members))
        below = true_descendants(members)
        on_cycle, rootless, ghosts, missing = set[object](), set[object](), set[object](), set[object]()
        for agent, core in members.items():
            membership = core.membership
            assert membership is not None
            where = (self.seed, self.step, agent)
            assert membership.path[-1] == agent, where
            assert len(set(membership.path)) == len(membership.path) == membership.level + 1, where
            assert (core.state is State.ROOT) == (membership.level == 0), where
            if cycle_of(members, agent):
                on_cycle.add(agent)
            root = members.get(membership.root)
            if root is None or root.state is not State.ROOT:
                rootless.add((agent, membership.root))
            table = {row.agent for row in membership.table()}
            ghosts |= {(agent, other) for other in table - below[agent]}
            if core.state is State.ROOT:
                missing |= {(agent, other) for other in below[agent] - table}
        self.cycle.note(on_cycle)
        self.rootless.note(rootless)
        self.ghost.note(ghosts)
        self.missing.note(missing)

    def run(self, steps: int, kills: bool) -> None:
        """So many steps; with `kills` a root dies each minute."""
        for step in range(steps):
            if kills and step % KILL_EVERY_STEPS == KILL_EVERY_STEPS - 1:
                self.kill_a_root()
            self.advance()


CASES = [(loss, kills, seed) for seed in (1, 2) for loss in (0.0, 0.3) for kills in (False, True)]


@pytest.fixture(
    scope="module",
    params=[*CASES[:4], *nightly(*CASES[4:])],
    ids=lambda case: f"loss {case[0]}, kills {case[1]}, seed {case[2]}",
)
def watched(request: pytest.FixtureRequest) -> tuple[Trees, float, bool]:
    """A swarm that has been watched through a run, its loss, and whether roots were killed."""
    loss, kills, seed = request.param
    trees = Trees(seed, f"radio.loss={loss}")
    trees.run(STEPS, kills)
    return trees, loss, kills


def test_trees_hold_in_every_step(watched: tuple[Trees, float, bool]) -> None:
    """Large trees were there to be watched; no agent ever claimed an event that it did not sense."""
    trees, _, kills = watched
    assert trees.most_in_trees >= (8 if kills else 15)
    assert trees.crew.world.refused_claims == 0
    assert all(core.rejected_frames == 0 for core in trees.crew.agents)
    assert all(controller.counts["rejected_frames"] == 0 for controller in controllers_of(trees.crew).values())


def test_no_cycle_lasts(watched: tuple[Trees, float, bool]) -> None:
    """None was seen up to 30 % loss, with a root killed each minute or without; 2 steps at 50 %."""
    trees, _, _ = watched
    assert trees.cycle.longest <= 2


def test_nobody_believes_in_a_dead_root_for_long(watched: tuple[Trees, float, bool]) -> None:
    """20 steps until a pulse counts as stalled, and the steps that the last one takes to the lowest level."""
    trees, loss, kills = watched
    bound = {(0.0, False): 5, (0.3, False): 20, (0.0, True): 30, (0.3, True): 35}[loss, kills]
    assert trees.rootless.longest <= bound


def test_ghosts_leave_the_tables(watched: tuple[Trees, float, bool]) -> None:
    """Who is below an agent no more is in its table for a while: mostly 12 steps of silence and a step per level.

    Without loss too, since a leaver at the edge may walk out of range before its first frame is heard.
    """
    trees, _, _ = watched
    assert trees.ghost.longest <= 32


def test_a_root_soon_knows_who_is_below_it(watched: tuple[Trees, float, bool]) -> None:
    """A step per level without loss, and some more with it."""
    trees, _, _ = watched
    assert trees.missing.longest <= 16


@pytest.mark.parametrize("seed", first_of([1, 2, 3]))
def test_all_agree_when_the_air_is_clear_again(seed: int) -> None:
    """After loss and killed members: each path is the parent's, each table is true, no orphan is left.

    Free agents are taken away and nobody dissolves or is sent elsewhere, so that nothing changes any more.
    """
    trees = Trees(seed, "radio.loss=0.3", "control.dissolution=false", "control.recruitment=false")
    trees.run(400, kills=False)
    followers = [agent for agent, core in trees.members.items() if core.state is not State.ROOT]
    for agent in trees.rng.sample(followers, 3):
        trees.crew.world.participants.token_gone(agent)
    trees.run(15, kills=False)
    (loss,) = (model for model in trees.crew.world.air._models if isinstance(model, Loss))
    loss._share = 0.0
    for _ in range(60):
        for agent, core in controllers_of(trees.crew).items():
            if core.membership is None:
                trees.crew.world.participants.token_gone(agent)
        trees.advance()
    assert len(trees.members) >= 5
    check_agreement(trees.members, seed)


@pytest.mark.parametrize("seed", first_of([1, 2]))
def test_trees_grow_with_a_slow_radio_too(seed: int) -> None:
    """With 5 s of latency most of the swarm has been in a tree within 400 s: an agent looks back that much farther."""
    trees = Trees(seed, "radio.latency_s=5")
    joined: set[int] = set()
    for _ in range(400):
        trees.advance()
        joined |= {agent for agent, core in trees.members.items() if core.state is State.MEMBER}
    assert len(joined) >= 15
