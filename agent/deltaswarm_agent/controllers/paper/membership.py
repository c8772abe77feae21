"""An agent's place in a tree: the path above it, and its descendants by its children's frames (F_i and S_i).

Kept only through messages: the path is the parent's plus the agent, the table the children plus their tables. Steps and
rules: "Trees by message" in `TREES.md`.
"""

from deltaswarm_agent.controllers.paper.frames import MAX_PATH, MAX_TABLE, Attending, Descendant, Member, PaperFrame
from deltaswarm_agent.controllers.paper.timers import Timers


class Branch:
    __slots__ = ("heard", "row", "table")

    def __init__(self, row: Descendant, table: tuple[Descendant, ...], heard: int) -> None:
        self.row = row
        self.table = table
        self.heard = heard


class PreviousTree:
    """The tree that an agent has just left."""

    __slots__ = ("_timers", "freed", "pulse", "pulse_step", "root")

    def __init__(self, membership: "Membership", freed: int, timers: Timers) -> None:
        self.root = membership.root
        self.pulse = membership.pulse
        self.pulse_step = membership.pulse_step
        self.freed = freed
        self._timers = timers

    def trusts(self, frame: Member, now: int) -> bool:
        """Whether the sender may be joined: in this tree, only while its root is known to be alive."""
        return (
            self.root != frame.path[0]
            or now - self.freed > self._timers.previous_tree
            or is_fresh(frame.pulse, self.pulse, self.pulse_step, now, self._timers.freshness)
        )


class Membership:
    """One agent's place in one tree, as a root (path of one) or below a parent."""

    def __init__(self, agent: int, parent: Member | None, now: int, timers: Timers) -> None:
        self._agent = agent
        self._timers = timers
        self.path: tuple[int, ...] = (agent,) if parent is None else (*parent.path, agent)
        self.pulse = 0 if parent is None else parent.pulse
        self.pulse_step = now
        self.parent_heard = now
        self._parents_table: tuple[Descendant, ...] = () if parent is None else parent.table
        self.heirs: frozenset[int] = frozenset()
        """The agents of which one takes the place of a lost root (`succession.py`)."""
        self.children: dict[int, Branch] = {}
        self.rows_cut = 0
        """Descendants that did not fit into the last table."""

    @property
    def root(self) -> int:
        return self.path[0]

    @property
    def parent(self) -> int:
        """The parent's id; a root's is its own."""
        return self.path[-2] if len(self.path) > 1 else self._agent

    @property
    def level(self) -> int:
        """Number of agents above this one (the paper's t_i)."""
        return len(self.path) - 1

    def beat(self, now: int) -> None:
        """A root counts its steps, from 0 in the first; the count travels down as proof that it lives."""
        if now != self.pulse_step:
            self.pulse += 1
            self.pulse_step = now

    def follow(self, parent: Member, now: int) -> bool:
        """Take path and pulse from the parent's frame; False if that would close a cycle."""
        if not fits_below(self._agent, parent):
            return False
        if parent.path[0] != self.root or parent.pulse > self.pulse:
            self.pulse = parent.pulse
            self.pulse_step = now
            self.heirs = frozenset()
        self.path = (*parent.path, self._agent)
        self.parent_heard = now
        self._parents_table = parent.table
        return True

    def siblings(self) -> frozenset[int]:
        """The children of its parent, as the parent told last, and itself."""
        return frozenset({row.agent for row in self._parents_table if row.parent == self.parent} | {self._agent})

    def become_root(self, now: int) -> None:
        """Become the root of the same tree; the pulse goes on as if the old root had not fallen silent."""
        self.path = (self._agent,)
        self.pulse += now - self.pulse_step
        self.pulse_step = now

    def adopts(self, frame: Member, now: int) -> bool:
        """Whether the sender may become the parent of an orphan or a recruited agent of this tree.

        Its pulse must be newer than the own one, and not much older than a living root's would be:
        else one orphan would attach to another that is cut off as well, or to its own descendant.
        """
        return (
            not frame.orphan
            and (frame.path[0] == self.root or frame.path[0] in self.heirs)
            and fits_below(self._agent, frame)
            and is_fresh(frame.pulse, self.pulse, self.pulse_step, now, self._timers.freshness)
        )

    def hear_children(self, heard: list[PaperFrame], now: int) -> None:
        """Keep the table of children: an agent that names this one as its parent is its child."""
        children, agent = self.children, self._agent
        for frame in heard:
            sender = frame.sender
            if type(frame) is Member and frame.path[-2:-1] == (agent,) and not frame.orphan:
                row = Descendant(sender, agent, frame.x_cm, frame.y_cm, frame.score)
                children[sender] = Branch(row, frame.table, now)
            elif sender in children and type(frame) is not Attending:
                del children[sender]
        if children:
            silent = [child for child, branch in children.items() if now - branch.heard >= self._timers.silence]
            for child in silent:
                del children[child]

    def table(self) -> tuple[Descendant, ...]:
        """All descendants, as the children tell; a child's own word about itself comes first.

        An ancestor that names this agent as its parent is left out: that is a cycle, about to be found.
        """
        self.rows_cut = 0
        if not self.children:
            return ()
        path = self.path
        rows = {child: branch.row for child, branch in self.children.items() if child not in path}
        for branch in self.children.values():
            for row in branch.table:
                if row.agent not in rows and row.agent not in path:
                    rows[row.agent] = row
        self.rows_cut = max(0, len(rows) - MAX_TABLE)
        return tuple(rows.values())[:MAX_TABLE]

    def has_below(self, agent: int) -> bool:
        return any(row.agent == agent for row in self.table())


def fits_below(agent: int, parent: Member) -> bool:
    """Whether an agent's path through this parent would be valid: no cycle, and not too long for a frame."""
    return agent not in parent.path and len(parent.path) < MAX_PATH


def is_fresh(pulse: int, known: int, known_step: int, now: int, freshness: int) -> bool:
    """Whether a pulse is newer than the known one, and about as new as a living root's."""
    return pulse > known and pulse >= known + (now - known_step) - freshness
