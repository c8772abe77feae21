"""Links that die in every phase of joining, recruiting and leaving, and come back: so does the agent."""

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from deltaswarm_agent.body import BodyContext
from deltaswarm_agent.controllers.paper.frames import Leaving, Member, PaperFrame, Relocating
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_board.bodies.kinematic import KinematicBody, KinematicSettings
from deltaswarm_board.driver import Driver
from deltaswarm_board.inbox import RadioInbox
from deltaswarm_wire.checked import load
from deltaswarm_wire.envelope import Sent, encode_sent
from deltaswarm_wire.settings import AgentSettings
from tests.support.cable import cable
from tests.support.cores import Core, opened
from tests.support.fields import EVENT_AT, TASK, board_table, boards, endpoint, free_port, listening

ROOT, ONE, OTHER = 0, 1, 2
STARTS = {ROOT: EVENT_AT, ONE: (10.0, 0.5), OTHER: (19.0, 18.0)}


class Field:
    """Three boards in one process: real drivers, bodies and inboxes, and an air that can fail for each of them."""

    def __init__(self, folder: Path, seed: int, **control: Any) -> None:
        table = {**TASK, "seed": seed, "control": {**TASK["control"], **control}}
        self.settings = load(AgentSettings, table)
        (folder / "events.csv").write_text("event,x_m,y_m\n1,10,10\n")
        self.drivers, self.bodies, self.inboxes = {}, {}, {}
        self.cores: dict[int, Core] = {}
        for agent, (x_m, y_m) in STARTS.items():
            options = load(KinematicSettings, {"x_m": x_m, "y_m": y_m, "events": str(folder / "events.csv")})
            body = KinematicBody(options, BodyContext(agent, self.settings, Random(seed + agent)))
            self.cores[agent] = Core(agent, self.settings)
            core = self.cores[agent].core
            self.drivers[agent] = Driver(core, body, step_s=self.settings.step_s, arrive_m=0.2, max_std_m=5.0)
            self.bodies[agent] = body
            self.inboxes[agent] = RadioInbox(agent, 3.0)
        self.said: dict[int, PaperFrame | None] = dict.fromkeys(STARTS)
        self.now = -1

    def step(self, off: set[int]) -> None:
        """One step of all; whoever is `off` the air neither hears nor is heard."""
        self.now += 1
        samples: dict[int, bytes | None] = {}
        for agent, driver in self.drivers.items():
            inbox = self.inboxes[agent]
            said = driver.step(self.now, float(self.now), lambda at, inbox=inbox: inbox.empty(self.now, at))
            samples[agent] = said.radio if said else None
            self.said[agent] = opened(agent, samples[agent])
        for sender, radio in samples.items():
            for hearer in STARTS:
                far_m = math.dist(self.bodies[sender].true_m, self.bodies[hearer].true_m)
                if radio is not None and not {sender, hearer} & off and far_m <= self.settings.range_m:
                    sent = encode_sent(Sent(self.now + 1000.0 * sender, 0.0, 0.0))  # by a clock of its own
                    self.inboxes[hearer].accept(sender, radio, sent, float(self.now))

    def until(self, condition: Callable[[], bool], what: str, off: set[int], steps: int = 6000) -> None:
        for _ in range(steps):
            if condition():
                return
            self.step(off)
        states = {agent: core.state.value for agent, core in self.cores.items()}
        raise AssertionError(f"not within {steps} steps: {what}; {states}, {self.said}")

    def until_in_tree(self, agent: int) -> None:
        self.until(lambda: self.is_in_tree(agent), f"agent {agent} in a tree", set())

    def state(self, agent: int) -> State:
        return self.cores[agent].state

    def is_known(self, agent: int) -> bool:
        """Whether some root has this agent in its table, and the agent knows that root as its own."""
        membership = self.cores[agent].membership
        root = self.said.get(membership.root) if membership else None
        return type(root) is Member and len(root.path) == 1 and any(row.agent == agent for row in root.table)

    def is_in_tree(self, agent: int) -> bool:
        """A root with somebody below it, or one that its root knows."""
        said = self.said[agent]
        if self.state(agent) is State.ROOT:
            return type(said) is Member and bool(said.table)
        return self.state(agent) is State.MEMBER and self.is_known(agent)


PHASES: dict[str, Callable[[Field], bool]] = {
    "before it joins": lambda field: field.state(ONE) is State.WALKING,
    "as it joins": lambda field: field.state(ONE) is State.MEMBER and not field.is_known(ONE),
    "a member": lambda field: field.state(ONE) is State.MEMBER and field.is_known(ONE),
    "as it is ordered": lambda field: (
        type(field.said[ROOT]) is Member and getattr(field.said[ROOT].order, "leaf", None) == ONE
    ),
    "on its way": lambda field: type(field.said[ONE]) is Relocating,
    "an orphan": lambda field: field.state(ONE) is State.ORPHAN,
    "as it leaves": lambda field: type(field.said[ONE]) is Leaving,
    "just free again": lambda field: type(field.said[ONE]) is Leaving and field.state(ONE) is State.WALKING,
}


def bring_about(field: Field, phase: str) -> None:
    """Steps until the phase; an orphan is made by a first loss of the link."""
    if phase != "an orphan":
        field.until(lambda: PHASES[phase](field), phase, set())
        return
    field.until(lambda: field.is_in_tree(ONE), "a member", set())
    field.until(lambda: PHASES[phase](field), phase, {ROOT, OTHER})


@pytest.mark.parametrize("whose", [{ONE}, {ROOT}, {ROOT, ONE, OTHER}], ids=["its own", "the root's", "everyone's"])
@pytest.mark.parametrize("phase", PHASES)
def test_a_link_lost_in_any_phase_loses_no_agent(phase: str, whose: set[int], tmp_path: Path) -> None:
    """For a moment, for long enough to be given up, and for very long: afterwards each agent is in a tree again."""
    for lost_steps in (2, 9, 30, 300):
        field = Field(tmp_path, seed=lost_steps, gamma_max=40)
        bring_about(field, phase)
        for _ in range(lost_steps):
            field.step(whose)
        for agent in STARTS:
            field.until_in_tree(agent)


@pytest.mark.processes
@pytest.mark.parametrize("fault", ["cut", "hold"])
@pytest.mark.parametrize("phase", ["joining", "recruiting", "leaving"])
def test_real_boards_come_back_when_their_link_does(phase: str, fault: str, tmp_path: Path) -> None:
    """The TCP connection between two boards dies, or only lets nothing through; then it is whole again."""
    ports = [free_port(), free_port()]
    leaves = phase == "leaving"
    own = {"recruitment": False, "gamma_max": 40} if leaves else {"recruitment_interval_s": 20.0}
    sensing = {"sensing_range_m": 2.0} if leaves else {}  # less than d_min: a member senses nothing
    with boards(tmp_path) as running, cable(ports[0]) as link, listening(*map(endpoint, ports)) as listener:
        for agent, connect in ((ROOT, []), (ONE, [endpoint(link.port)])):
            air = {"listen": [endpoint(ports[agent])], "connect": connect, "range_m": 9.0}
            table = board_table(agent, STARTS[agent], air, tmp_path)
            table["agent"] = {**TASK, **sensing, "control": {**TASK["control"], **own}}
            running.start(table, "--accelerate", "20")
            if agent == ROOT:  # before the other can come to the event, and be the root itself
                listener.wait_for(lambda: listener.path(ROOT) == (ROOT,), "a root")
        if phase == "joining":
            listener.wait_for(lambda: listener.path(ONE) == (ROOT, ONE), "a member")
        else:
            kind = Relocating if phase == "recruiting" else Leaving
            listener.wait_for(lambda: type(listener.radio.get(ONE)) is kind, f"a frame of kind {kind.__name__}")
        link.cut() if fault == "cut" else link.hold()
        listener.wait_for(lambda: listener.path(ONE) != (ROOT, ONE), "the member's loss of its root")
        listener.wait_for(lambda: ONE not in listener.table(ROOT), "the root's loss of its member")
        link.mend()
        # Apart, the other may have come to the event as well, and a root may have left: either may be below the other.
        listener.wait_for(lambda: ONE in listener.table(ROOT) or ROOT in listener.table(ONE), "a tree of both again")
        assert listener.alive == {ROOT, ONE}
        assert [running.stop(agent) for agent in (ROOT, ONE)] == [0, 0]
