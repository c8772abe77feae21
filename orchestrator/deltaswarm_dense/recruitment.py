"""Active Recruitment (`controllers/paper/recruitment.py`)."""

from deltaswarm_agent.controllers.paper.recruitment import MAX_TRIES
from deltaswarm_dense.arithmetic import distance_m, rounded, squared_m2, steps_of
from deltaswarm_dense.beliefs import to_cm
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.layout import (
    AGENT_ID,
    LEAF,
    NONE,
    ORDER_FIELDS,
    ORDER_NUMBER,
    ORDER_X_CM,
    ORDER_Y_CM,
    PARENT,
    ROW_X_CM,
    ROW_Y_CM,
    SCORE,
    TTL,
)
from deltaswarm_dense.membership import has_below, table_of
from deltaswarm_dense.randomness import place_of_choice, random, uniform
from deltaswarm_dense.states import ORDERED, change
from deltaswarm_dense.whereabouts import distance_m2, is_reachable


@compiled
def recruit(swarm, agent, now):
    """Let a root give an order when due, and repeat the last one until it expires."""
    settings = swarm.settings[0]
    if settings.recruitment and agent.pulse > 0 and agent.pulse % settings.recruit_every == 0:
        new_order(settings, agent, swarm.trees, swarm.beliefs, swarm.recruits, now)
    else:
        pass_on(agent, agent.carried, agent.has_carried)


@compiled
def pass_on(agent, order, is_given):
    """Take an order after one more hop; none once it has expired (`passed_on`)."""
    agent.has_order = is_given and order[TTL] > 1
    if agent.has_order:
        for k in range(ORDER_FIELDS):
            agent.order[k] = order[k]
        agent.order[TTL] -= 1


@compiled
def new_order(settings, agent, trees, beliefs, recruits, now):
    """Send the weakest leaf where most known events are; no order without a leaf or such a place."""
    table, until, members_m = trees.table, recruits.until[agent.id], recruits.members_m
    agent.has_order = False
    rows = table_of(agent, trees, table)
    weakest = weakest_leaf(agent, trees, rows)
    if weakest == NONE:
        return
    leaf = table[weakest, AGENT_ID]
    for other in range(until.size):
        if until[other] <= now:
            until[other] = 0
    here_x_m, here_y_m = table[weakest, ROW_X_CM] * 0.01, table[weakest, ROW_Y_CM] * 0.01
    members_m[0, 0], members_m[0, 1] = agent.x_m, agent.y_m
    count = 1
    for k in range(rows):
        if k != weakest:
            members_m[count, 0], members_m[count, 1] = table[k, ROW_X_CM] * 0.01, table[k, ROW_Y_CM] * 0.01
            count += 1
    score_cells(settings, agent, beliefs, recruits)
    found, x_m, y_m = best_place(settings, agent, recruits, leaf, count, (here_x_m, here_y_m))
    if not found and settings.any_place:
        found, x_m, y_m = draw(settings, agent, recruits, leaf, count)
    if not found:
        return
    travel_s = distance_m(here_x_m, here_y_m, x_m, y_m) / settings.speed_mps
    until[leaf] = now + settings.order + steps_of(travel_s, settings.step_s) + settings.arrival
    recruits.goals_m[agent.id, leaf, 0], recruits.goals_m[agent.id, leaf, 1] = x_m, y_m
    agent.has_order = True
    agent.order[LEAF], agent.order[ORDER_X_CM], agent.order[ORDER_Y_CM] = leaf, to_cm(x_m), to_cm(y_m)
    agent.order[ORDER_NUMBER], agent.order[TTL] = now, settings.order


@compiled
def weakest_leaf(agent, trees, rows):
    """Return the row of the leaf that senses the fewest events, ties at random; NONE in a tree without leaves."""
    table, marks = trees.table, trees.marks
    trees.stamp[0] += 1
    stamp = trees.stamp[0]
    for k in range(rows):
        marks[table[k, PARENT]] = stamp
    least, ties = NONE, 0
    for k in range(rows):
        if marks[table[k, AGENT_ID]] != stamp:
            if ties == 0 or table[k, SCORE] < least:
                least, ties = table[k, SCORE], 1
            elif table[k, SCORE] == least:
                ties += 1
    if ties == 0:
        return NONE
    before = chosen = NONE
    for _ in range(place_of_choice(agent, ties) + 1):  # in the order of ids
        chosen = NONE
        for k in range(rows):
            is_tied = marks[table[k, AGENT_ID]] != stamp and table[k, SCORE] == least
            is_next = chosen == NONE or table[k, AGENT_ID] < table[chosen, AGENT_ID]
            if is_tied and is_next and table[k, AGENT_ID] > before:
                chosen = k
        before = table[chosen, AGENT_ID]
    return chosen


@compiled
def is_legal_cell(settings, recruits, root, leaf, count, cell):
    """Return whether a root may send a leaf to a cell (`Legal.__contains__`)."""
    x, y = cell
    if not (0.0 <= x <= settings.width_m and 0.0 <= y <= settings.height_m):
        return False
    within = False
    for k in range(count):
        m2 = squared_m2(x - recruits.members_m[k, 0], y - recruits.members_m[k, 1], settings.two)
        if m2 < settings.d_min_m2:
            return False
        within = within or m2 <= settings.reach_m2
    if not within:
        return False
    until, goals_m = recruits.until[root], recruits.goals_m[root]
    for other in range(until.size):
        if until[other] and other != leaf:
            if squared_m2(x - goals_m[other, 0], y - goals_m[other, 1], settings.two) < settings.d_min_m2:
                return False
    return True


@compiled
def draw(settings, agent, recruits, leaf, count):
    """Draw one of the legal places, each with the same probability (`Legal.draw`)."""
    reach_m, members_m = settings.reach_m, recruits.members_m
    for _ in range(MAX_TRIES):
        k = place_of_choice(agent, count)
        x = rounded(uniform(agent, members_m[k, 0] - reach_m, members_m[k, 0] + reach_m))
        y = rounded(uniform(agent, members_m[k, 1] - reach_m, members_m[k, 1] + reach_m))
        if is_legal_cell(settings, recruits, agent.id, leaf, count, (x, y)):
            near = 0
            for other in range(count):
                near += abs(x - members_m[other, 0]) <= reach_m and abs(y - members_m[other, 1]) <= reach_m
            if near * random(agent) < 1.0:
                return True, float(x), float(y)
    return False, 0.0, 0.0


@compiled
def score_cells(settings, agent, beliefs, recruits):
    """Count for each cell of the arena how many known events are sensed from there."""
    scores, cells, places = recruits.scores, recruits.cells, beliefs.places[agent.id]
    for x in range(scores.shape[0]):
        for y in range(scores.shape[1]):
            scores[x, y] = 0
    for at in range(agent.places):
        event_x_m, event_y_m = places[at].x_cm / 100, places[at].y_cm / 100
        cx, cy = rounded(event_x_m), rounded(event_y_m)
        fx, fy = cx - event_x_m, cy - event_y_m
        for k in range(cells.shape[0]):
            x, y = cx + cells[k, 0], cy + cells[k, 1]
            is_sensed = squared_m2(cells[k, 0] + fx, cells[k, 1] + fy, settings.two) <= settings.sensing_m2
            if is_sensed and 0 <= x < scores.shape[0] and 0 <= y < scores.shape[1]:
                scores[x, y] += 1


@compiled
def best_place(settings, agent, recruits, leaf, count, here_m):
    """Return whether a legal place senses a known event, and the one that senses most, the nearest among equals."""
    scores, most = recruits.scores, 0
    for x in range(scores.shape[0]):
        for y in range(scores.shape[1]):
            most = max(most, scores[x, y])
    for score in range(most, 0, -1):
        found, best_x, best_y, best_m2 = False, 0, 0, 0.0
        for x in range(scores.shape[0]):
            for y in range(scores.shape[1]):
                if scores[x, y] == score and is_legal_cell(settings, recruits, agent.id, leaf, count, (x, y)):
                    m2 = squared_m2(x - here_m[0], y - here_m[1], settings.two)
                    if not found or m2 < best_m2:
                        found, best_x, best_y, best_m2 = True, x, y, m2
        if found:
            return True, float(best_x), float(best_y)
    return False, 0.0, 0.0


@compiled
def hear_order(settings, agent, trees, frame, now):
    """Carry out the parent's order, or pass it on; return whether this agent goes."""
    if not frame.has_order:
        return False
    if frame.order[LEAF] != agent.id:
        if frame.order[TTL] > 1 and has_below(agent, trees, frame.order[LEAF]):
            pass_on(agent, frame.order, True)
        return False
    x_m, y_m = frame.order[ORDER_X_CM] / 100, frame.order[ORDER_Y_CM] / 100
    if agent.children > 0 or frame.order[ORDER_NUMBER] == agent.followed_order:
        return False
    if not is_reachable(settings, x_m, y_m):
        return False
    agent.followed_order = frame.order[ORDER_NUMBER]
    agent.goal_x_m, agent.goal_y_m = x_m, y_m
    agent.since = now + 1
    change(settings, agent, now, ORDERED)
    return True


@compiled
def has_arrived(settings, agent, now):
    """Return whether a recruited agent is at its goal; until it is, its search for a parent has not begun."""
    if distance_m2(settings, agent, agent.goal_x_m, agent.goal_y_m) <= settings.at_place_m2:
        return True
    agent.since = now + 1
    return False
