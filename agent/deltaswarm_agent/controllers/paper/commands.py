"""The operator's commands under the paper's control structures. The paper has no commands; these are ours.

- `set delta`: sets how many events sensed at once make the agent a root from now on (hybrid control only).
- `set structure`: the same, finer: with a fraction of delta, that share of the agents takes the next greater delta, and
  only a share of the agents works on events outside trees; the others only walk, as under hierarchical control.
- `set price`: sets what a message is worth, and lets the agents' policy set delta again (learned and bandit only).
- `recall`: a tree dissolves from its root down, and its agents found no tree for a while.
- `attend`: free agents near a place go there; what they sense on the way comes first. It ends with the command's life.
- `hold`: an agent that walks, or goes to an event, stands still; `resume` ends it.
"""

from collections.abc import Sequence
from dataclasses import replace

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.bandit import ARMS
from deltaswarm_agent.controllers.paper.hybrid import Strategy
from deltaswarm_agent.controllers.paper.settings import BANDIT, FIXED, PRICED
from deltaswarm_agent.controllers.paper.states import FREE, Cause
from deltaswarm_wire.commands import AGENT, ALL, CIRCLE, PLACE, TREE, ArgumentForm, Command, CommandForm
from deltaswarm_wire.messages import Pose

SET_DELTA, RECALL, ATTEND, HOLD, RESUME = "set delta", "recall", "attend", "hold", "resume"
SET_STRUCTURE, SET_PRICE = "set structure", "set price"
ANYBODY = (ALL, CIRCLE, TREE, AGENT)

FORMS = (
    CommandForm(
        SET_DELTA,
        ANYBODY,
        (ArgumentForm("delta", "integer", 1, 1000, default=3, help="events sensed at once that make an agent a root"),),
        "How many events sensed at once make an agent a root. More is less centralised. For hybrid control only.",
        refused_in=("decentralised", "hierarchical"),
    ),
    CommandForm(
        SET_STRUCTURE,
        ANYBODY,
        (
            ArgumentForm(
                "delta", "number", 1, 1000, default=3, help="3.2: a fifth of the agents has delta 4, the rest 3"
            ),
            ArgumentForm("working", "number", 0, 1, default=1, help="share of the agents that work outside trees"),
        ),
        "How much of the swarm is centralised, in small steps. For hybrid control only.",
        refused_in=("decentralised", "hierarchical"),
    ),
    CommandForm(
        SET_PRICE,
        ANYBODY,
        (
            ArgumentForm(
                "message_price",
                "number",
                0,
                1000,
                default=1,
                unit="s",
                help="delay of an event that a message is worth",
            ),
        ),
        "Tell me less (a higher price) or more (a lower one). For agents that have learned to choose delta by it.",
        refused_in=("decentralised", "hierarchical"),
    ),
    CommandForm(
        RECALL,
        (TREE,),
        (ArgumentForm("pause_s", "number", 0, 3600, default=60, unit="s", help="they start no tree for this long"),),
        "Dissolve a tree: its root gives up, and its members go their own ways. Refused by agents outside any tree.",
        refused_in=("decentralised",),
    ),
    CommandForm(
        ATTEND,
        (PLACE,),
        (ArgumentForm("within_m", "number", 1, 1000, default=20, unit="m", help="free agents within this range go"),),
        "Send the free agents near a place to it. All others refuse.",
    ),
    CommandForm(
        HOLD,
        ANYBODY,
        (ArgumentForm("for_s", "number", 1, 86400, default=300, unit="s", help="after this they go on by themselves"),),
        "Make agents stand still; they go on observing, reporting and joining trees.",
    ),
    CommandForm(RESUME, ANYBODY, (), "End a hold, and an order to go to a place."),
)


def obey(agent: Agent, commands: Sequence[Command]) -> None:
    """Start carrying out new commands; note those that are done or refused at once, and a walk that is over."""
    if agent.goto is not None and agent.now >= agent.goto_until:
        agent.end_errand(agent.refused)
    for command in commands:
        outcome = _RULES[command.name](agent, command)
        if outcome is not None:
            (agent.done if outcome else agent.refused).append(command.number)


def _set_delta(agent: Agent, command: Command) -> bool | None:
    strategy, delta = agent.strategy, int(command.arguments["delta"])
    attends = strategy.attends or strategy.rule in PRICED  # what a policy has chosen ends with its rule
    return _restructure(agent, command, replace(strategy, founds_at=delta, attends=attends, rule=FIXED))


def _set_structure(agent: Agent, command: Command) -> bool | None:
    least, fraction = divmod(float(command.arguments["delta"]), 1)
    founds_at, attends = int(least) + (agent.rank < fraction), agent.rank < float(command.arguments["working"])
    return _restructure(agent, command, replace(agent.strategy, founds_at=founds_at, attends=attends, rule=FIXED))


def _set_price(agent: Agent, command: Command) -> bool | None:
    rule, bandit = agent.settings.delta_rule, agent.bandit
    if rule not in PRICED:
        return False
    founds_at, attends = ARMS[bandit.arm] if bandit is not None else (agent.strategy.founds_at, True)
    strategy = replace(agent.strategy, founds_at=founds_at, attends=attends, rule=rule)
    return _restructure(agent, command, strategy, float(command.arguments["message_price"]))


def _restructure(agent: Agent, command: Command, strategy: Strategy, price_s: float | None = None) -> bool | None:
    """Change the strategy, and the price, unless a later order, heard before this one, has done so."""
    if not agent.strategy.has_delta:
        return False
    if _is_superseded(agent, command, agent.strategy_command):
        return None
    agent.strategy_command = command.number
    agent.strategy = strategy
    if price_s is not None:
        agent.price_s = price_s
    if agent.bandit is not None:
        agent.bandit.count(strategy.rule == BANDIT, agent.now)
    if not strategy.attends and agent.target is not None:
        agent.change(Cause.TAKEN_OFF)
    return True


def _is_superseded(agent: Agent, command: Command, newest: int) -> bool:
    """Whether a later order than this one was heard before it, which is then noted."""
    if command.number >= newest:
        return False
    agent.superseded.append(command.number)
    return True


def _recall(agent: Agent, command: Command) -> bool:
    membership = agent.membership
    if membership is None:
        return False
    agent.founds_from = agent.now + agent.steps(command.arguments["pause_s"])
    agent.leave_tree(Cause.RECALLED)
    return True


def _attend(agent: Agent, command: Command) -> bool | None:
    until = agent.now + agent.steps(command.life_s)
    if agent.goto is not None and agent.errand_command == command.number:  # heard again with a longer life
        agent.goto_until = until
        return None
    if _is_superseded(agent, command, agent.errand_command):
        return None
    x_m, y_m = command.target.numbers
    within_m = float(command.arguments["within_m"])
    is_near = agent.here.distance_m2(x_m, y_m) <= within_m**2
    if agent.state not in FREE or not is_near or not agent.here.is_reachable(x_m, y_m):
        return False
    agent.end_errand(agent.superseded)
    agent.goto, agent.goto_until, agent.errand_command = (x_m, y_m), until, command.number
    return None


def _hold(agent: Agent, command: Command) -> bool | None:
    if _is_superseded(agent, command, agent.hold_command):
        return None
    agent.hold_command = command.number
    agent.holds_until = agent.now + agent.steps(command.arguments["for_s"])
    return True


def _resume(agent: Agent, command: Command) -> bool | None:
    """End what was ordered before; a later order that was heard before this one stays."""
    if _is_superseded(agent, command, min(agent.hold_command, agent.errand_command)):
        return None
    if command.number >= agent.hold_command:
        agent.hold_command, agent.holds_until = command.number, agent.now
    if command.number >= agent.errand_command:
        agent.end_errand(agent.superseded)
        agent.errand_command = command.number
    return True


_RULES = {
    SET_DELTA: _set_delta,
    SET_STRUCTURE: _set_structure,
    SET_PRICE: _set_price,
    RECALL: _recall,
    ATTEND: _attend,
    HOLD: _hold,
    RESUME: _resume,
}


def goto(agent: Agent) -> Pose | None:
    """Return where the operator has sent a walking agent; the walk ends on arrival, or if something is in the way."""
    if agent.goto is not None and agent.here.is_at(*agent.goto):
        agent.end_errand(agent.done)
    elif agent.goto is not None and not agent.here.is_reachable(*agent.goto):
        agent.end_errand(agent.refused)
    return agent.goto
