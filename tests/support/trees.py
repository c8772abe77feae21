"""What trees kept by messages look like beside the truth: who is below whom, who is on a cycle, and for how long."""

from collections import defaultdict
from collections.abc import Iterable

from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.states import State


class Spans:
    """For how many steps on end something has been so, by key."""

    def __init__(self) -> None:
        self.longest = 0
        self.now: dict[object, int] = defaultdict(int)

    def note(self, keys: Iterable[object]) -> None:
        """These it is in this step."""
        self.now = defaultdict(int, {key: self.now[key] + 1 for key in keys})
        self.longest = max([self.longest, *self.now.values()])


def true_descendants(members: dict[int, PaperController]) -> dict[int, set[int]]:
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


def parent_of(members: dict[int, PaperController], agent: int) -> int:
    """Its own id, if it is a root or has no parent at the time."""
    membership = members[agent].membership
    assert membership is not None
    return membership.parent if members[agent].state is State.MEMBER else agent


def cycle_of(members: dict[int, PaperController], agent: int) -> frozenset[int]:
    """The agents on the way up from an agent back to itself; none for one that is on no cycle."""
    way = [agent]
    while (above := parent_of(members, way[-1])) in members and above != way[-1]:
        if above == agent:
            return frozenset(way)
        if above in way:
            break
        way.append(above)
    return frozenset()


def check_agreement(members: dict[int, PaperController], where: object) -> None:
    """Every path is the parent's path, every pulse the root's less a step per level, and every table is true."""
    assert {core.state for core in members.values()} <= {State.ROOT, State.MEMBER}, where
    below = true_descendants(members)
    for agent, core in members.items():
        membership = core.membership
        assert membership is not None
        assert {row.agent for row in membership.table()} == below[agent], (where, agent)
        if core.state is State.MEMBER:
            parent, root = members[membership.parent].membership, members[membership.root].membership
            assert parent is not None
            assert root is not None
            assert membership.path == (*parent.path, agent), (where, agent)
            assert membership.pulse == root.pulse - membership.level, (where, agent)
