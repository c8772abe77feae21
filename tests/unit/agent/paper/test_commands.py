"""The operator's commands in small swarms under the paper's control structures, in one process."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import pytest

from deltaswarm_agent.controllers.paper.commands import obey
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.commands import Command, Target
from deltaswarm_wire.operator_messages import DONE, HEARD, REFUSED, SUPERSEDED, Clock
from tests.support.commanding import script
from tests.support.cores import Lone, controllers_of, swarm

QUIET = ("events.rate_hz=0", "record=off")
BUSY = ("agents.count=12", "events.rate_hz=0.06", "control.delta=2", "record=off")


def play(found: InProcess, steps: int) -> Iterator[tuple[int, StepRecord]]:
    for step in range(steps):
        record = found.step(step, step == steps - 1)
        yield step, record
        found.close_step(Clock(step, record.time_s, step == steps - 1))


def places(found: InProcess) -> list[list[float]]:
    made: list[list[float]] = found.world.environment.positions_m.tolist()
    return made


def roots(found: InProcess) -> dict[int, int]:
    standings = found.world._tree_statuses.items()
    return {agent: status.root for agent, status in standings if status.root >= 0}


def states(found: InProcess) -> list[int]:
    """What each agent says of command 0; -1: it does not know it."""
    known = [{answer.command: answer.state for answer in core.commands.answers()} for core in found.agents]
    return [answers.get(0, -1) for answers in known]


def test_another_delta_changes_who_becomes_a_root() -> None:
    """With a delta that no place reaches there is no tree, before the command; after it there are some."""
    found = swarm("smoke", "control.delta=60", script([120, "set delta", "all", [], {"delta": 1}]))
    trees = {step: record.trees for step, record in play(found, 240)}
    assert all(trees[step] == 0 for step in range(120))
    assert any(trees[step] for step in range(121, 240))
    assert states(found) == [DONE] * 6


def test_a_structure_gives_shares_of_the_swarm_their_own_rules() -> None:
    """Of 25 agents ten take the next greater delta, and five work alone; an older order heard later is void."""
    found = swarm(
        "smoke", "agents.count=25", *QUIET, script([3, "set structure", "all", [], {"delta": 2.4, "working": 0.2}])
    )
    for _ in play(found, 40):
        pass
    agents = [controller.agent for controller in controllers_of(found).values()]
    assert Counter(agent.delta for agent in agents) == {2: 15, 3: 10}
    assert sum(agent.strategy.attends for agent in agents) == 5
    for number, delta in ((9, 4.0), (8, 7.0)):
        obey(agents[1], [Command(number, "set structure", Target("all"), {"delta": delta, "working": 1.0}, 60.0)])
    assert agents[1].delta == 4
    assert (agents[1].done[-1], agents[1].superseded) == (9, [8])


@pytest.mark.parametrize("heard", [(1, 2), (2, 1)])
def test_an_older_order_that_is_heard_later_changes_nothing(heard: tuple[int, ...]) -> None:
    """A hold that came after a resume holds, in whichever order an agent hears of them; so does a newer errand."""
    lone = Lone(mode="hybrid")
    lone.step()
    agent = lone.core.controller.agent
    orders = {
        1: Command(1, "resume", Target("all"), {}, 120.0),
        2: Command(2, "hold", Target("all"), {"for_s": 300.0}, 120.0),
    }
    obey(agent, [orders[number] for number in heard])
    assert agent.holds_until == agent.now + 300
    assert 2 in agent.done
    errands = {
        3: Command(3, "attend", Target("place", (52.0, 50.0)), {"within_m": 20.0}, 120.0),
        4: Command(4, "attend", Target("place", (50.0, 53.0)), {"within_m": 20.0}, 120.0),
    }
    obey(agent, [errands[number + 2] for number in heard])
    assert agent.goto == (50.0, 53.0)
    assert 3 in agent.superseded
    obey(agent, [Command(0, "resume", Target("all"), {}, 120.0)])
    assert (agent.goto, agent.superseded[-1]) == ((50.0, 53.0), 0)
    obey(agent, [Command(5, "resume", Target("all"), {}, 120.0)])
    assert (agent.goto, agent.holds_until) == (None, agent.now)


def test_who_is_taken_off_leaves_its_event() -> None:
    """And reports nothing from then on, though it still senses the event; under another order it comes back."""
    orders = [[at_s, "set structure", "all", [], {"delta": 60, "working": w}] for at_s, w in ((200, 0), (300, 1))]
    found = swarm("smoke", "events.rate_hz=0.06", "record=off", script(*orders))
    free = {State.GOING, State.ATTENDING}
    at_work = [sum(controller.state in free for controller in controllers_of(found).values()) for _ in play(found, 420)]
    assert max(at_work[150:200]) > 0
    assert max(at_work[260:300]) == 0
    assert max(at_work[350:]) > 0


def test_a_tree_and_a_circle_have_their_own_delta() -> None:
    circle = script([10, "set delta", "circle", [0, 20, 20], {"delta": 9}])
    found = swarm("smoke", *QUIET, circle)
    for step, _ in play(found, 12):
        if step == 10:
            near = {agent for agent, place in enumerate(places(found)) if math.dist(place, (0, 20)) <= 20}
    changed = {agent for agent, one in controllers_of(found).items() if one.agent.strategy.founds_at == 9}
    assert changed == near
    assert 0 < len(near) < 6
    assert states(found) == [DONE if agent in near else HEARD for agent in range(6)]


@pytest.mark.parametrize("mode", ["decentralised", "hierarchical"])
def test_only_hybrid_control_has_a_delta(mode: str) -> None:
    found = swarm("smoke", *QUIET, f"control.mode={mode}", script([5, "set delta", "all", [], {"delta": 1}]))
    assert list(play(found, 8))
    assert states(found) == [REFUSED] * 6


def test_a_tree_that_is_recalled_dissolves_and_founds_no_new_one_for_the_pause() -> None:
    busy = ("agents.count=12", "events.rate_hz=0.3", "control.delta=1", "record=off", "control.gamma_max=500")
    at, pause, root, tree = 0, 70, -1, set[int]()
    free = swarm("smoke", *busy)
    for step, _ in play(free, 250):
        trees = roots(free)
        largest = max(set(trees.values()), key=list(trees.values()).count, default=-1)
        if step > 60 and list(trees.values()).count(largest) >= 3:
            at, root = step, largest
            break
    assert root >= 0
    commanded = swarm("smoke", *busy, script([at, "recall", "tree", [root], {"pause_s": pause}]))
    refounded = []
    for step, _ in play(commanded, at + 200):
        trees = roots(commanded)
        if step == at - 1:
            tree = {agent for agent, own in trees.items() if own == root}
            assert len(tree) >= 2
        if at + 15 <= step < at + pause:
            assert root not in trees.values()
        if step >= at and (new := {agent for agent in tree if trees.get(agent) == agent}):
            refounded += [step] if step > at else []
            assert step == at or step >= at + pause, new
    assert refounded


def test_free_agents_near_a_place_go_there() -> None:
    """And tell that they have been there; those farther away go on as before."""
    found = swarm("smoke", *QUIET, script([20, "attend", "place", [8, 30], {"within_m": 18}, 200]))
    least = [math.inf] * 6
    for step, _ in play(found, 120):
        if step == 20:
            near = {agent for agent, place in enumerate(places(found)) if math.dist(place, (8, 30)) <= 18}
        if step > 20:
            least = [min(before, math.dist(place, (8, 30))) for before, place in zip(least, places(found), strict=True)]
    assert 0 < len(near) < 6
    assert all(least[agent] < 1 for agent in near)
    assert states(found) == [DONE if agent in near else REFUSED for agent in range(6)]
    assert all(one.state is State.WALKING for one in controllers_of(found).values())


def test_an_errand_ends_with_the_life_of_its_command() -> None:
    """Who has not arrived by then walks as before, and says that it could not."""
    found = swarm("smoke", *QUIET, "run.step_s=0.5", script([20, "attend", "place", [8, 30], {"within_m": 60}, 12]))
    for step, record in play(found, 80):
        errands = [one.agent.goto for one in controllers_of(found).values()]
        assert any(errands) == (40 <= step < 40 + 24), (step, record.time_s)
    assert set(states(found)) == {DONE, REFUSED}


@pytest.mark.parametrize("after", [("attend", "place", [30, 8], {"within_m": 60}), ("resume", "all", [], {})])
def test_a_later_command_replaces_an_errand(after: tuple[Any, ...]) -> None:
    found = swarm("smoke", *QUIET, script([20, "attend", "place", [8, 30], {"within_m": 60}], [25, *after]))
    assert list(play(found, 40))
    assert set(states(found)) <= {DONE, SUPERSEDED}
    assert SUPERSEDED in states(found)


def test_who_is_pushed_behind_an_obstacle_gives_the_errand_up() -> None:
    """The way is checked in each step, not when the command comes."""
    wall = "arena.obstacles=[{corners_m=[[18, 14], [22, 14], [22, 26], [18, 26]]}]"
    found = swarm("smoke", *QUIET, wall, script([0, "attend", "place", [20, 30], {"within_m": 60}]))
    victim = -1
    for step, _ in play(found, 20):
        if step == 5:
            victim = next(agent for agent, one in controllers_of(found).items() if one.agent.goto)
            found.world.environment.positions_m[victim] = (20.0, 12.0)
    assert states(found)[victim] == REFUSED


def test_a_place_outside_the_arena_is_refused() -> None:
    found = swarm("smoke", *QUIET, script([5, "attend", "place", [-9, 30], {"within_m": 1000}]))
    assert list(play(found, 10))
    assert states(found) == [REFUSED] * 6


@pytest.mark.parametrize("resumed", [False, True])
def test_who_is_held_stands_still_until_its_time_or_resume(resumed: bool) -> None:
    rows: list[Sequence[Any]] = [[10, "hold", "all", [], {"for_s": 40}]]
    rows += [[30, "resume", "agent", [2], {}]] if resumed else []
    found = swarm("smoke", *QUIET, script(*rows))
    where = [places(found) for _, _ in play(found, 70)]
    still = [[before[agent] == after[agent] for before, after in pairwise(where)] for agent in range(6)]
    for agent in range(6):
        end = 30 if resumed and agent == 2 else 50
        assert all(still[agent][10:end])
        assert not any(still[agent][:10] + still[agent][end:])


def test_commands_spread_from_agent_to_agent() -> None:
    """One agent in the base's reach is enough: in time all know it, though the base reaches few."""
    near = ("downlink.base_m=[0, 0]", "downlink.range_m=12", "radio.loss=0.3", "agents.count=12")
    found = swarm("smoke", *QUIET, *near, script([5, "hold", "agent", [3], {"for_s": 5}, 280]))
    knows = []
    for _, _ in play(found, 280):
        knows.append(sum(state >= 0 for state in states(found)))
    assert knows == sorted(knows)
    assert knows[4] == 0
    assert knows[-1] == 12
    assert found.world.downlink.totals["dropped"]["range"] > 0


COMMANDS = script(
    [0, "set delta", "all", [], {"delta": 1}],
    [60, "hold", "circle", [20, 20, 12], {"for_s": 45}],
    [70, "set structure", "all", [], {"delta": 1.5, "working": 0.5}],
    [100, "attend", "place", [10, 30], {"within_m": 30}],
    [110, "resume", "all", [], {}],
    [150, "recall", "tree", [1], {"pause_s": 30}],
    [151, "recall", "tree", [2], {"pause_s": 30}],
    [180, "set delta", "all", [], {"delta": 3}, 20],
    [200, "hold", "tree", [4], {"for_s": 300}],
)


@pytest.mark.parametrize(
    "sets",
    [
        ["control.mode=hybrid"],
        ["control.mode=decentralised"],
        ["control.mode=hierarchical", "downlink.range_m=15", "downlink.base_m=[0, 0]"],
        ["control.mode=hybrid", "downlink.loss=0.6", "downlink.latency_s=2", "downlink.jitter_s=4", "radio.loss=0.3"],
        ["control.mode=hybrid", "radio.latency_s=2", "radio.jitter_s=3", "run.step_s=0.5"],
    ],
    ids=" ".join,
)
def test_commanded_agents_decide_the_same_with_and_without_sleep(sets: list[str]) -> None:
    """Frames on the air, roles, places and reports; and the sleep saves work. The books of frames close."""

    def states_of(*more: str) -> Iterator[tuple[tuple[Any, ...], int]]:
        found = swarm("smoke", *BUSY, COMMANDS, *sets, *more)
        sent = arrived = 0
        for _, record in play(found, 320):
            world = found.world
            sent += 11 * record.frames_sent
            arrived += record.frames_received + sum(record.frames_dropped.values()) - record.frames_duplicated
            assert sent == arrived + record.frames_in_flight
            reports = [forwarded.report for forwarded in world.forwarded]
            yield (world.intake.transmitted, world._tree_statuses, places(found), reports), record.agents_asked
        assert len(found.world.turns.log) >= 6

    asleep = awake = 0
    for step, ((one, few), (other, many)) in enumerate(
        zip(states_of(), states_of("run.ask_every_step=true"), strict=True)
    ):
        assert one == other, step
        asleep, awake = asleep + few, awake + many
    assert asleep < awake


def test_a_swarm_without_commands_does_not_notice_a_downlink() -> None:
    """Its digest is that of the same run without one."""
    digests = set()
    for sets in ((), ("downlink.loss=0.5", "downlink.jitter_s=3", "downlink.base_m=[1, 1]", "downlink.range_m=9")):
        found = swarm("smoke", *BUSY, *sets)
        assert list(play(found, 60))
        digests.add((found.world.digest.hex(), found.operator.digest_hex))
    assert len(digests) == 1
