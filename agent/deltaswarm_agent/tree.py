"""Membership in a tree, kept by messages alone (the rules "Trees by message" of `agent/PROTOCOL.md`).

All counts are in steps. What is known of a tree is the path from the root to oneself, and the table of
one's descendants as one's children tell it (the paper's F_i and S_i).
"""

from collections.abc import Sequence

from deltaswarm_wire.radio import MAX_PATH, MAX_TABLE, Attending, Descendant, Member, RadioFrame

SILENCE_STEPS = 12
"""A parent or a child that has not been heard for so long is lost."""

STALL_STEPS = 20
"""A pulse that has not advanced for so long means that the root is dead or cut off."""

FRESHNESS_STEPS = 8
"""How far behind its expected value a pulse may be for its bearer to be trusted as a parent."""

FORMER_STEPS = 20
"""For so long a freed agent is as careful with its former tree as an orphan."""

LEAVING_STEPS = 4
"""Leaving is said in so many frames."""

ORPHAN_STRICT_STEPS, ORPHAN_STEPS = 2, 5
"""An orphan takes parents at legal distance only, then any in range, then gives up."""

ARRIVAL_STRICT_STEPS, ARRIVAL_STEPS = 3, 8
"""The same for a mover at its place."""

CONTESTED_STEPS = 12
"""After so many frames of about equal roots, none of which has yielded, the lower id decides."""

RANGE_MARGIN_M = 0.02
"""Members keep this far within range: places are rounded to centimetres."""


class Branch:
    """A child, and its own table."""

    __slots__ = ("heard", "row", "table")

    def __init__(self, row: Descendant, table: tuple[Descendant, ...], heard: int) -> None:
        self.row = row
        self.table = table
        self.heard = heard


class Former:
    """The tree that an agent has just left."""

    __slots__ = ("freed", "pulse", "pulse_step", "root")

    def __init__(self, root: int, pulse: int, pulse_step: int, freed: int) -> None:
        self.root = root
        self.pulse = pulse
        self.pulse_step = pulse_step
        self.freed = freed

    def trusts(self, frame: Member, now: int) -> bool:
        """Whether the sender may be joined: one of this tree only while its root is known to live."""
        return (
            self.root != frame.path[0]
            or now - self.freed > FORMER_STEPS
            or is_fresh(frame.pulse, self.pulse, self.pulse_step, now)
        )


class Membership:
    """One agent's place in one tree, as a root (path of one) or below a parent."""

    def __init__(self, agent: int, parent: Member | None, gamma: int, now: int) -> None:
        self._agent = agent
        self.path: tuple[int, ...] = (agent,) if parent is None else (*parent.path, agent)
        self.pulse = 0 if parent is None else parent.pulse
        self.pulse_step = now
        self.parent_heard = now
        self.gamma = gamma
        self.children: dict[int, Branch] = {}
        self._contested = 0

    @property
    def root(self) -> int:
        """The root that this agent believes in."""
        return self.path[0]

    @property
    def parent(self) -> int:
        """The parent's id; a root's is its own."""
        return self.path[-2] if len(self.path) > 1 else self._agent

    @property
    def level(self) -> int:
        """Number of agents above this one (the paper's t_i)."""
        return len(self.path) - 1

    def senior_of(self, roots: Sequence[Member]) -> Member | None:
        """The root heard to which this one, a root too, yields; None if it stays.

        With latency in the air two roots of about the same age each seem the senior to themselves. When
        both have stayed for long, the one with the higher id yields.
        """
        seniors = [frame for frame in roots if is_senior(frame, self.pulse, self._agent)]
        if not seniors:
            oldest = self.pulse - FRESHNESS_STEPS
            equals = [frame for frame in roots if frame.sender < self._agent and frame.pulse >= oldest]
            self._contested += bool(equals)
            if self._contested >= CONTESTED_STEPS:
                seniors = equals
        return min(seniors, key=lambda frame: (-frame.pulse, frame.sender), default=None)

    def beat(self, now: int) -> None:
        """A root counts its steps; the count travels down as proof that it lives."""
        self.pulse += 1
        self.pulse_step = now

    def follow(self, parent: Member, now: int) -> bool:
        """Take path and pulse from the parent's frame; False if that would close a cycle."""
        if not fits_below(self._agent, parent):
            return False
        if parent.path[0] != self.root or parent.pulse > self.pulse:
            self.pulse = parent.pulse
            self.pulse_step = now
        self.path = (*parent.path, self._agent)
        self.parent_heard = now
        return True

    def adopts(self, frame: Member, now: int) -> bool:
        """Whether the sender may become the parent of an orphan or a mover of this tree.

        Its pulse must be newer than the own one, and not much older than a living root's would be:
        else one orphan would attach to another that is cut off as well, or to its own descendant.
        """
        return (
            not frame.orphan
            and frame.path[0] == self.root
            and fits_below(self._agent, frame)
            and is_fresh(frame.pulse, self.pulse, self.pulse_step, now)
        )

    def hear_children(self, heard: Sequence[RadioFrame], now: int) -> None:
        """Keep the table of children: who names this agent as its parent is one."""
        children, agent = self.children, self._agent
        for frame in heard:
            sender = frame.sender
            if type(frame) is Member and frame.path[-2:-1] == (agent,) and not frame.orphan:
                row = Descendant(sender, agent, frame.x_cm, frame.y_cm, frame.score)
                children[sender] = Branch(row, frame.table, now)
            elif sender in children and type(frame) is not Attending:
                del children[sender]
        if children:
            silent = [child for child, branch in children.items() if now - branch.heard >= SILENCE_STEPS]
            for child in silent:
                del children[child]

    def table(self) -> tuple[Descendant, ...]:
        """All descendants, as the children tell; a child's own word about itself comes first.

        An ancestor is none, though it name this agent as its parent: that is a cycle, about to be found.
        """
        if not self.children:
            return ()
        path = self.path
        rows = {child: branch.row for child, branch in self.children.items() if child not in path}
        for branch in self.children.values():
            for row in branch.table:
                if row.agent not in rows and row.agent not in path:
                    rows[row.agent] = row
        return tuple(rows.values())[:MAX_TABLE]

    def former(self, now: int) -> Former:
        """What to remember of this tree when leaving it."""
        return Former(self.root, self.pulse, self.pulse_step, now)


def fits_below(agent: int, parent: Member) -> bool:
    """Whether an agent's path by this parent would be one: without a cycle, and not too long to be said."""
    return agent not in parent.path and len(parent.path) < MAX_PATH


def is_fresh(pulse: int, known: int, known_step: int, now: int) -> bool:
    """Whether a pulse is newer than the known one, and about as new as a living root's."""
    return pulse > known and pulse >= known + (now - known_step) - FRESHNESS_STEPS


def is_senior(rival: Member, pulse: int, agent: int) -> bool:
    """Whether another root is senior: the longer pulse of the step before this one, equal ones by lower id.

    A pulse that comes later than one step is too short and never too long. So who yields to its senior is
    the younger in truth, and roots cannot yield in a ring.
    """
    return (rival.pulse, -rival.sender) > (pulse, -agent)
