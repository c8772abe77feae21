"""Trees in whole swarms: what message-kept trees look like beside the truth, with loss, kills and silenced roots.

An agent knows nothing of the truth; here it is compared with it. Bounds were measured over 60 swarms, with
some slack; the page of the protocol says why they hold.
"""

import random
from collections import defaultdict
from collections.abc import Iterator

import pytest

from deltaswarm_agent.core import AgentCore
from deltaswarm_agent.states import State
from deltaswarm_orchestrator.in_process import InProcess
from tests.cores import swarm

STEPS, SETTLED_STEPS, KILL_EVERY_STEPS = 800, 200, 60

BUSY = ("events.rate_hz=0.1", "arena.width_m=70", "arena.height_m=70", "events.density.mean_m=[35, 35]")
"""The paper's swarm in half the area with twice the events: many trees soon."""


class Spans:
    """For how many steps on end something has been so, by key."""

    def __init__(self) -> None:
        self.longest = 0
        self._spans: dict[object, int] = defaultdict(int)

    def note(self, keys: set[object]) -> None:
        """These it is in this step."""
        self._spans = defaultdict(int, {key: self._spans[key] + 1 for key in keys})
        self.longest = max([self.longest, *self._spans.values()])


def true_descendants(members: dict[int, AgentCore]) -> dict[int, set[int]]:
    """By agent all that are below it, by the parents that they name; orphans and movers have none."""
    below: dict[int, set[int]] = {agent: set() for agent in members}
    for agent in members:
        seen = {agent}
        above = parent_of(members, agent)
        while above in members and above not in seen:
            below[above].add(agent)
            seen.add(above)
            above = parent_of(members, above)
    return below


def parent_of(members: dict[int, AgentCore], agent: int) -> int:
    """Its own id, if it is a root or has no parent at the time."""
    membership = members[agent].membership
    assert membership is not None
    return membership.parent if members[agent].state is State.MEMBER else agent


def is_on_cycle(members: dict[int, AgentCore], agent: int) -> bool:
    """Whether going up from an agent leads back to it; a root, its own parent, is on none."""
    at = parent_of(members, agent)
    for _ in range(len(members)):
        if at == agent or at not in members or at == parent_of(members, at):
            break
        at = parent_of(members, at)
    return at == agent != parent_of(members, agent)


class Trees:
    """A swarm under watch."""

    def __init__(self, seed: int, *sets: str) -> None:
        self.seed = seed
        self.crew: InProcess = swarm("paper-25", *BUSY, *sets, seed=seed)
        self.alive = self.crew.world.lockstep.alive
        self.rng = random.Random(seed)
        self.step = -1
        self.cycle, self.rootless, self.ghost, self.missing = Spans(), Spans(), Spans(), Spans()
        self.most_in_trees = 0

    @property
    def members(self) -> dict[int, AgentCore]:
        """The living agents in trees."""
        return {core.agent: core for core in self.crew.agents if core.membership and core.agent in self.alive}

    def kill_a_root(self) -> None:
        """Silence one, if there is any, while enough agents are left to go on."""
        roots = [agent for agent, core in self.members.items() if core.state is State.ROOT]
        if roots and len(self.alive) > 12:
            self.crew.world.lockstep.gone(self.rng.choice(roots))

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
            if is_on_cycle(members, agent):
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

    def run(self, steps: int, kills: bool) -> Iterator[int]:
        """So many steps; with `kills` a root dies each minute."""
        for step in range(steps):
            if kills and step % KILL_EVERY_STEPS == KILL_EVERY_STEPS - 1:
                self.kill_a_root()
            self.advance()
            yield step
