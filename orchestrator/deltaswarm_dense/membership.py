"""An agent's place in a tree: the path above it, and its descendants (`controllers/paper/membership.py`)."""

from deltaswarm_agent.controllers.paper.frames import ATTENDING, MAX_PATH, MAX_TABLE
from deltaswarm_agent.controllers.paper.frames import MEMBER as MEMBER_FRAME
from deltaswarm_dense.bandit import ARM, follow_arm
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import AGENT_ID, CHILDREN, NONE, PARENT, ROW_FIELDS, ROW_X_CM, ROW_Y_CM, SCORE
from deltaswarm_dense.states import change


@compiled
def level_of(agent):
    """Return the number of agents above this one (the paper's t_i)."""
    return agent.path_length - 1


@compiled
def parent_of(agent):
    """Return an agent's parent; a root's is itself."""
    return agent.path[agent.path_length - 2] if agent.path_length > 1 else agent.id


@compiled
def enter_tree(swarm, agent, now, parent, cause):
    """Become a member below the sender `parent`, or with NONE a root (`Agent.enter_tree`)."""
    settings = swarm.settings[0]
    change(settings, agent, now, cause)
    agent.in_tree = True
    agent.path_length = 1
    agent.path[0] = agent.id
    agent.pulse = 0
    agent.parents_rows = agent.heirs = agent.children = 0
    if parent != NONE:
        _take_path(settings, agent, swarm.air, swarm.trees, parent)
        agent.pulse = heard_of(swarm.air, parent).pulse
        if settings.tries and heard_of(swarm.air, parent).tried[ARM] != NONE:
            follow_arm(settings, agent, heard_of(swarm.air, parent).tried[ARM], now)
    agent.pulse_step = agent.parent_heard = now
    stay(settings, agent)
    agent.contested_steps = 0
    agent.target = agent.followed_order = NONE
    agent.has_order = False
    forget_recruits(swarm.recruits.until, agent)
    agent.leave_frames_left = 0


@compiled
def _take_path(settings, agent, air, trees, parent):
    frame = heard_of(air, parent)
    for k in range(frame.path_length):
        agent.path[k] = frame.path[k]
    agent.path[frame.path_length] = agent.id
    agent.path_length = frame.path_length + 1
    if settings.root_succession:
        agent.parents_rows = frame.rows
        copy_rows(trees.parents_tables[agent.id], air.tables[air.slots[parent], parent], frame.rows)


@compiled
def copy_rows(to, of, rows):
    """Copy the first rows of a table."""
    for row in range(rows):
        for field in range(ROW_FIELDS):
            to[row, field] = of[row, field]


@compiled
def forget_recruits(until, agent):
    """Forget which agents a root has sent where."""
    for other in range(until.shape[1]):
        until[agent.id, other] = 0


@compiled
def stay(settings, agent):
    """Restart the wait for events (`Agent.stay`)."""
    agent.gamma = settings.gamma_max
    agent.idle_s = 0.0


@compiled
def leave_tree(settings, agent, now, cause):
    """Become free; the subtree follows, since children hear it (`Agent.leave_tree`)."""
    agent.previous_root, agent.previous_pulse = agent.path[0], agent.pulse
    agent.previous_pulse_step, agent.freed = agent.pulse_step, now
    agent.in_tree = False
    agent.leave_frames_left = settings.leaving
    change(settings, agent, now, cause)


@compiled
def trusts(settings, agent, now, frame):
    """Return whether a sender may be joined: in the previous tree, only while its root is known to be alive."""
    return (
        agent.previous_root != frame.path[0]
        or now - agent.freed > settings.previous_tree
        or is_fresh(frame.pulse, agent.previous_pulse, agent.previous_pulse_step, now, settings.freshness)
    )


@compiled
def beat(agent, now):
    """Let a root count its steps."""
    if now != agent.pulse_step:
        agent.pulse += 1
        agent.pulse_step = now


@compiled
def follow(settings, agent, air, trees, now, parent):
    """Take path and pulse from the parent's frame; return False if that would close a cycle."""
    frame = heard_of(air, parent)
    if not fits_below(agent, frame):
        return False
    if frame.path[0] != agent.path[0] or frame.pulse > agent.pulse:
        agent.pulse, agent.pulse_step = frame.pulse, now
        agent.heirs = 0
    _take_path(settings, agent, air, trees, parent)
    agent.parent_heard = now
    return True


@compiled
def adopts(settings, agent, heirs, now, frame):
    """Return whether the sender may become the parent of an orphan or a recruited agent of this tree."""
    if frame.orphan:
        return False
    is_ours = frame.path[0] == agent.path[0]
    for k in range(agent.heirs):
        is_ours = is_ours or heirs[agent.id, k] == frame.path[0]
    return (
        is_ours
        and fits_below(agent, frame)
        and is_fresh(frame.pulse, agent.pulse, agent.pulse_step, now, settings.freshness)
    )


@compiled
def fits_below(agent, frame):
    """Return whether an agent's path through this parent would be valid."""
    for k in range(frame.path_length):
        if frame.path[k] == agent.id:
            return False
    return frame.path_length < MAX_PATH


@compiled
def is_fresh(pulse, known, known_step, now, freshness):
    """Return whether a pulse is newer than the known one, and about as new as a living root's."""
    return pulse > known and pulse >= known + (now - known_step) - freshness


@compiled
def hear_children(settings, agent, air, trees, now, heard):
    """Keep the branches: an agent that names this one as its parent is its child. Return the trouble, if there is."""
    i = agent.id
    children, branches = trees.children[i], trees.branches[i]
    for k in range(heard.size):
        sender = heard[k]
        frame = heard_of(air, sender)
        at = _place_of_child(agent, children, branches, sender)
        names_us = frame.kind == MEMBER_FRAME and frame.path_length > 1 and frame.path[frame.path_length - 2] == i
        if names_us and not frame.orphan:
            if at == NONE:
                at = _new_child(agent, children)
                if at == NONE:
                    return CHILDREN
            slot = children[at]
            branch = branches[slot]
            branch.child, branch.x_cm, branch.y_cm = sender, frame.x_cm, frame.y_cm
            branch.score, branch.heard, branch.rows = frame.score, now, frame.rows
            copy_rows(trees.branch_tables[i, slot], air.tables[air.slots[sender], sender], frame.rows)
        elif at != NONE and frame.kind != ATTENDING:
            _drop_child(agent, children, at)
    at = 0
    while at < agent.children:
        if now - branches[children[at]].heard >= settings.silence:
            _drop_child(agent, children, at)
        else:
            at += 1
    return 0


@compiled
def _place_of_child(agent, children, branches, child):
    for at in range(agent.children):
        if branches[children[at]].child == child:
            return at
    return NONE


@compiled
def _new_child(agent, children):
    """Take a free slot for one more child, the last in order; return its place, NONE if there is no slot."""
    for slot in range(children.size):
        is_free = True
        for at in range(agent.children):
            is_free = is_free and children[at] != slot
        if is_free:
            children[agent.children] = slot
            agent.children += 1
            return agent.children - 1
    return NONE


@compiled
def _drop_child(agent, children, at):
    for later in range(at + 1, agent.children):
        children[later - 1] = children[later]
    agent.children -= 1


@compiled
def table_of(agent, trees, table):
    """Write all descendants to a table, children first; return their number."""
    marks = trees.marks
    trees.stamp[0] += 1
    stamp = trees.stamp[0]
    for k in range(agent.path_length):
        marks[agent.path[k]] = stamp
    children, branches, rows = trees.children[agent.id], trees.branches[agent.id], 0
    for at in range(agent.children):
        branch = branches[children[at]]
        if marks[branch.child] != stamp and rows < MAX_TABLE:
            marks[branch.child] = stamp
            table[rows, AGENT_ID], table[rows, PARENT] = branch.child, agent.id
            table[rows, ROW_X_CM], table[rows, ROW_Y_CM] = branch.x_cm, branch.y_cm
            table[rows, SCORE] = branch.score
            rows += 1
    for at in range(agent.children):
        below = trees.branch_tables[agent.id, children[at]]
        for k in range(branches[children[at]].rows):
            if marks[below[k, AGENT_ID]] != stamp and rows < MAX_TABLE:
                marks[below[k, AGENT_ID]] = stamp
                for field in range(ROW_FIELDS):
                    table[rows, field] = below[k, field]
                rows += 1
    return rows


@compiled
def has_below(agent, trees, other):
    """Return whether an agent is a descendant."""
    for k in range(table_of(agent, trees, trees.table)):
        if trees.table[k, AGENT_ID] == other:
            return True
    return False
