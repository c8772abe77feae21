"""The tree protocol whatever happens to the air and the agents: what `TREES.md` says under "What holds".

A few agents in a small arena, real controllers and real bytes, an air that loses, delays, reorders and doubles
frames and falls into parts, agents that die, freeze, come late and begin anew. After each step the trees are
compared with the truth; hypothesis chooses what happens, and prints it when a property breaks.
"""

import math
from collections import defaultdict
from dataclasses import replace
from random import Random
from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_wire.messages import Event, Frame
from tests.support.cores import STEPS, Core, Place, agent_settings
from tests.support.trees import Spans, check_agreement, cycle_of, true_descendants

SIZE_M, RANGE_M, SENSING_RANGE_M = 30.0, 10.0, 5.0
AGENTS = 7
WORK_AGENT_STEPS = 60
"""An event is complete when it has been observed so often."""

CYCLE_STEPS = STEPS.silence
"""A cycle lasts at most so long for each agent on it; add the latency."""

ROOTLESS_STEPS = STEPS.silence + STEPS.orphan
"""A root that is none any more is believed in at most so long for each level; add the latency."""

GHOST_STEPS = STEPS.silence
"""Who is not below an agent any more is in its table at most so long for each level between them; add the latency."""

HEALED_STEPS = STEPS.stall + STEPS.orphan + STEPS.silence
"""In a clear air all members of a tree agree after so long, and two steps per level."""

seeds = st.integers(0, 2**16)
agents = st.integers(0, AGENTS - 1)
shares = st.sampled_from([0.0, 0.1, 0.3, 0.5])


class Swarm:
    def __init__(self, seed: int, latency_steps: int, started: int, **control: Any) -> None:
        self.rng = Random(seed)
        self.settings = agent_settings(
            seed=seed, width_m=SIZE_M, height_m=SIZE_M, latency_s=float(latency_steps), **control
        )
        self.latency_steps = latency_steps
        self.loss = self.duplication = 0.0
        self.step = -1
        self.at: dict[int, Place] = {agent: self.anywhere() for agent in range(AGENTS)}
        self.side = dict.fromkeys(range(AGENTS), 0)
        self.cores: dict[int, Core] = {}
        self.frozen: set[int] = set()
        self.starts: dict[int, int] = defaultdict(int)
        self.events: dict[int, list[float]] = {}
        self.is_quiet = False
        """Free agents hear and sense nothing, and whoever is in a tree senses an event: no tree changes by its will."""
        self._flying: dict[int, list[tuple[int, int, bytes]]] = defaultdict(list)
        self._events_made = 0
        for agent in range(started):
            self.start(agent)

    def anywhere(self) -> Place:
        return self.rng.uniform(0, SIZE_M), self.rng.uniform(0, SIZE_M)

    def start(self, agent: int) -> None:
        self.cores[agent] = Core(agent, self.settings, self.starts[agent])
        self.starts[agent] += 1
        self.frozen.discard(agent)

    @property
    def members(self) -> dict[int, PaperController]:
        """The agents in trees that are neither dead nor frozen."""
        return {agent: core.controller for agent, core in self.awake if core.membership}

    @property
    def awake(self) -> list[tuple[int, Core]]:
        return [(agent, core) for agent, core in sorted(self.cores.items()) if agent not in self.frozen]

    def add_events(self, count: int, x_m: float, y_m: float) -> None:
        for _ in range(count):
            self._events_made += 1
            place = (min(max(c + self.rng.uniform(-3, 3), 0.0), SIZE_M) for c in (x_m, y_m))
            self.events[self._events_made] = [*place, WORK_AGENT_STEPS]

    def advance(self) -> None:
        self.step += 1
        flying = self._flying.pop(self.step, [])
        for agent, core in self.awake:
            is_out = self.is_quiet and core.membership is None
            heard = [] if is_out else [(sender, data) for sender, to, data in flying if to == agent]
            said = core.core.step(
                Frame(self.step, float(self.step), False, *self.at[agent], (), self._sensed(agent), tuple(heard))
            )
            for event in said.act.observed:
                if event in self.events:
                    self.events[event][2] -= 1
            x_m, y_m = self.at[agent]
            self.at[agent] = (x_m + said.act.vx_mps, y_m + said.act.vy_mps)
            if said.radio is not None:
                self._send(agent, said.radio)
        self._land()
        self.events = {event: found for event, found in self.events.items() if found[2] > 0}

    def _sensed(self, agent: int) -> tuple[Event, ...]:
        if self.is_quiet:
            return (Event(2**20 + agent, *self.at[agent]),) if self.cores[agent].membership else ()
        return tuple(
            Event(event, x_m, y_m)
            for event, (x_m, y_m, _) in self.events.items()
            if math.dist((x_m, y_m), self.at[agent]) <= SENSING_RANGE_M
        )

    def _send(self, sender: int, data: bytes) -> None:
        """To all, by ways of their own; who is in range is decided when the step is over."""
        for to in self.cores:
            if to != sender and self.side[to] == self.side[sender]:
                for _ in range(1 + (self.rng.random() < self.duplication)):
                    if self.rng.random() >= self.loss:
                        due = self.step + 1 + self.rng.randint(0, self.latency_steps)
                        self._flying[due].append((sender, to, data))

    def _land(self) -> None:
        """What was sent is heard where the receiver is in range when it comes."""
        landing = self._flying.get(self.step + 1, [])
        landing[:] = [row for row in landing if math.dist(self.at[row[0]], self.at[row[1]]) <= RANGE_M]
        self.rng.shuffle(landing)


class TreeProtocol(RuleBasedStateMachine):
    swarm: Swarm

    @initialize(
        seed=seeds,
        latency_steps=st.integers(0, 3),
        started=st.integers(2, AGENTS),
        mode=st.sampled_from(["hybrid", "hierarchical", "adaptive"]),
        idle_root=st.sampled_from(["stays", "leaves"]),
        recruitment_places=st.sampled_from(["with-events", "any"]),
        root_succession=st.booleans(),
        recruitment_interval_s=st.sampled_from([13, 60]),
        d_min_m=st.sampled_from([1.0, 4.0, 6.0]),
    )
    def begin(self, seed: int, latency_steps: int, started: int, **control: Any) -> None:
        """A swarm of some of the agents; the others may come later."""
        self.swarm = Swarm(seed, latency_steps, started, delta=2, rho=1, gamma_max=30, **control)
        self.cycles, self.rootless, self.ghosts = Spans(), Spans(), Spans()
        self.add_events(3, SIZE_M / 2, SIZE_M / 2)
        self.run(30)

    @rule(loss=shares, duplication=shares)
    def change_the_air(self, loss: float, duplication: float) -> None:
        self.swarm.loss, self.swarm.duplication = loss, duplication

    @rule(agent=agents)
    def die(self, agent: int) -> None:
        self.swarm.cores.pop(agent, None)

    @rule()
    def lose_a_root(self) -> None:
        roots = [agent for agent, core in self.swarm.members.items() if core.state is State.ROOT]
        if roots:
            self.die(self.swarm.rng.choice(roots))

    @rule(agent=agents)
    def freeze(self, agent: int) -> None:
        """It misses steps, and knows what it knew when it goes on."""
        self.swarm.frozen.add(agent)

    @rule(agent=agents)
    def thaw(self, agent: int) -> None:
        self.swarm.frozen.discard(agent)

    @rule(agent=agents)
    def begin_anew(self, agent: int) -> None:
        """Late, after a death, or at once: where the body is, with nothing known and the counter at 0."""
        self.swarm.start(agent)

    @rule(sides=st.lists(st.integers(0, 1), min_size=AGENTS, max_size=AGENTS))
    def part(self, sides: list[int]) -> None:
        self.swarm.side = dict(enumerate(sides))

    @rule()
    def reunite(self) -> None:
        self.swarm.side = dict.fromkeys(range(AGENTS), 0)

    @rule(count=st.integers(1, 4), x_m=st.integers(0, int(SIZE_M)), y_m=st.integers(0, int(SIZE_M)))
    def add_events(self, count: int, x_m: float, y_m: float) -> None:
        self.swarm.add_events(count, x_m, y_m)

    @rule(count=st.integers(1, 4), agent=agents)
    def add_events_near(self, count: int, agent: int) -> None:
        self.swarm.add_events(count, *self.swarm.at[agent])

    @rule(steps=st.integers(1, 25))
    def run(self, steps: int) -> None:
        for _ in range(steps):
            self.swarm.advance()
            self.check(self.swarm.latency_steps)

    @precondition(lambda self: len(self.swarm.members) > 1)
    @rule()
    def heal(self) -> None:
        """A clear air, and no mover on its way: soon all members of a tree agree."""
        swarm = self.swarm
        late_steps, swarm.latency_steps = swarm.latency_steps, 0
        swarm.frozen.clear()
        self.change_the_air(0.0, 0.0)
        self.reunite()
        swarm.is_quiet = True
        self._recruit(False)
        quiet = 0
        while quiet < HEALED_STEPS + late_steps + 2 * (AGENTS - 1):
            swarm.advance()
            self.check(late_steps)
            quiet = 0 if any(core.state is State.RELOCATING for core in swarm.cores.values()) else quiet + 1
        check_agreement(swarm.members, swarm.step)
        swarm.is_quiet = False
        swarm.latency_steps = late_steps
        self._recruit(True)

    def _recruit(self, on: bool) -> None:
        for core in self.swarm.cores.values():
            agent = core.controller.agent
            agent.settings = replace(agent.settings, recruitment=on)

    def check(self, late_steps: int) -> None:
        """What must hold after each step; no frame is later than `late_steps`."""
        members = self.swarm.members
        memberships = {agent: membership_of(core) for agent, core in members.items()}
        for agent, membership in memberships.items():
            assert membership.path[-1] == agent
            assert len(set(membership.path)) == len(membership.path)
            assert (members[agent].state is State.ROOT) == (membership.level == 0)
            assert not set(membership.path) & {row.agent for row in membership.table()}
        self.no_cycle_lasts(members, late_steps)
        self.no_dead_root_is_believed_in_for_long(members, late_steps)
        self.no_ghost_stays_in_a_table(members, late_steps)

    def no_cycle_lasts(self, members: dict[int, PaperController], late_steps: int) -> None:
        """At most CYCLE_STEPS and the latency, for each agent on it."""
        cycles = {cycle for agent in members if (cycle := cycle_of(members, agent))}
        self._hold(self.cycles, {cycle: len(cycle) * (CYCLE_STEPS + late_steps) for cycle in cycles})

    def no_dead_root_is_believed_in_for_long(self, members: dict[int, PaperController], late_steps: int) -> None:
        """At most ROOTLESS_STEPS and the latency, for each level; one that began anew is another root."""
        found: dict[object, int] = {}
        for agent, core in members.items():
            own, root = membership_of(core), members.get(membership_of(core).root)
            is_alive = root is not None and root.state is State.ROOT and membership_of(root).pulse >= own.pulse
            if not is_alive and core.state is not State.RELOCATING:
                found[agent, own.root] = own.level * (ROOTLESS_STEPS + late_steps)
        self._hold(self.rootless, found)

    def no_ghost_stays_in_a_table(self, members: dict[int, PaperController], late_steps: int) -> None:
        """At most GHOST_STEPS and the latency, for each level between them."""
        below = true_descendants(members)
        found: dict[object, int] = {}
        for agent, core in members.items():
            parents = {row.agent: row.parent for row in membership_of(core).table()}
            for other in parents.keys() - below[agent]:
                found[agent, other] = levels_between(parents, other, agent) * (GHOST_STEPS + late_steps)
        self._hold(self.ghosts, found)

    def _hold(self, spans: Spans, bounds: dict[object, int]) -> None:
        """What is so now, and for how many steps on end it may be."""
        spans.note(bounds)
        for key, bound in bounds.items():
            assert spans.now[key] <= bound, (self.swarm.step, key, spans.now[key], bound)


def membership_of(core: PaperController) -> Membership:
    """An agent's, who is in a tree."""
    assert core.membership is not None
    return core.membership


def levels_between(parents: dict[int, int], agent: int, top: int) -> int:
    """Levels from one agent up to another, by a table; as many as it has rows where these do not lead there."""
    levels = 1
    while (agent := parents.get(agent, agent)) != top and levels < len(parents):
        levels += 1
    return levels


TestTreeProtocol = TreeProtocol.TestCase
TestTreeProtocol.settings = settings(stateful_step_count=30)
