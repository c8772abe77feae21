"""Five boards and an operator on six machines with addresses of their own, no world anywhere."""

import csv
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.support.fields import EVENT_AT, RUN, TASK, Boards, Listener, board_table, boards, listening
from tests.support.namespaces import HUB, NEEDS_NAMESPACES, Network, network
from tests.support.swarms import PATIENCE_S, wait_until

pytestmark = NEEDS_NAMESPACES

IS_LONG = "DELTASWARM_LONG" in os.environ
FACTOR = 1 if IS_LONG else 5
"""Simulated per wall second. With 1 all times are as they say, and a test takes minutes."""

WITHIN_S = 300.0 if IS_LONG else 120.0
PORT = 7447
AGENTS = range(5)
ROOT = 0
STARTS = (EVENT_AT, (10.0, 3.0), (16.0, 14.0), (4.0, 14.0), (10.0, 17.0))
OFF_S = 60.0
"""How long a link is down, in simulated time."""


class Field:
    def __init__(self, folder: Path, net: Network, running: Boards, listener: Listener) -> None:
        self.out = folder / "operator"
        self.net = net
        self.boards = running
        self.listener = listener
        self._said = folder / "operator.err"
        self._operator: subprocess.Popen[bytes] | None = None

    def start_operator(self, stack: ExitStack) -> None:
        """At the hub, listening; boards connect to it."""
        command = [*self.net.inside(HUB), sys.executable, "-P", "-m", "deltaswarm_operator", "--no-world"]
        command += ["--run", RUN, "--out", str(self.out), "--listen", f"tcp/{self.net.address(HUB)}:{PORT}"]
        with self._said.open("wb") as said:
            operator = subprocess.Popen([*command, "--status-every-s", "2"], stderr=said)
        stack.callback(operator.wait)
        stack.callback(operator.kill)
        self._operator = operator

    def operator_says(self, text: str, after: int = 0) -> None:
        """Until a line of the operator has this text, beyond so many characters."""
        wait_until(lambda: text in self.said[after:], f"the operator says {text!r}; it says {self.said}", WITHIN_S)

    @property
    def said(self) -> str:
        return self._said.read_text()

    def wait_for_tree(self, without: frozenset[int] = frozenset()) -> None:
        wanted = set(AGENTS) - {ROOT} - without
        self.listener.wait_for(lambda: self.listener.table(ROOT) == wanted, f"a tree of {wanted}", WITHIN_S)

    def wait_for_a_recruit(self) -> None:
        """Until some leaf was told to move to another place, and is 1 m from where it was; some have less far to go."""

        def has_moved() -> bool:
            pairs = [(self.listener.radio[agent], from_m) for agent, from_m in list(self.listener.moved.items())]
            return any(math.dist((frame.x_cm / 100, frame.y_cm / 100), from_m) > 1.0 for frame, from_m in pairs)

        self.listener.wait_for(has_moved, "a leaf that was recruited and has moved", WITHIN_S)

    def end(self) -> tuple[list[dict[str, str]], dict[str, Any]]:
        assert self._operator is not None
        self._operator.send_signal(signal.SIGTERM)
        assert self._operator.wait(PATIENCE_S) == 0
        for agent in AGENTS:
            assert self.boards.stop(agent) == 0, self.boards.said(agent)
        with (self.out / "operator.csv").open(newline="") as table:
            rows = list(csv.DictReader(table))
        return rows, json.loads((self.out / "operator.json").read_text())


@contextmanager
def field(folder: Path, delay_s: float = 0.0, loss: float = 0.0) -> Iterator[Field]:
    """Five machines with a board each, each connected to the operator and to the boards before it.

    The test listens through a socket in the file system, past the network.
    """
    with ExitStack() as stack:
        net = stack.enter_context(network(len(AGENTS), delay_s, loss))
        running = stack.enter_context(boards(folder))
        sockets = [f"unixsock-stream/{folder}/{agent}.sock" for agent in AGENTS]
        made = Field(folder, net, running, stack.enter_context(listening(*sockets)))
        made.start_operator(stack)
        control = {**TASK["control"], "recruitment_interval_s": 20.0}
        for agent in AGENTS:
            others = [f"tcp/{net.address(other)}:{PORT}" for other in (HUB, *range(agent))]
            links = {"listen": [f"tcp/{net.address(agent)}:{PORT}", sockets[agent]], "connect": others, "range_m": 9.0}
            table: Mapping[str, Any] = board_table(agent, STARTS[agent], links, folder)
            told = {**table, "agent": {**TASK, "control": control}}
            running.start(told, "--accelerate", str(FACTOR), inside=net.inside(agent))
            made.listener.wait_for(lambda: made.listener.path(ROOT) == (ROOT,), "a root, before another can be one")
        yield made


def check_the_operators_books(rows: list[dict[str, str]], totals: dict[str, Any]) -> None:
    """Every report is in some row, and everybody who was there is known."""
    assert sum(int(row["messages"]) for row in rows) == totals["messages"]
    assert totals["messages"] > 0
    assert [int(row["step"]) for row in rows] == sorted({int(row["step"]) for row in rows})
    assert set(totals["agents"]) == {str(agent) for agent in AGENTS}
    assert totals["rejected"] == 0


def test_boards_and_an_operator_need_no_world(tmp_path: Path) -> None:
    """A tree forms, a recruited leaf moves, the operator sees who is alive and gets every report."""
    with field(tmp_path) as made:
        made.operator_says("5 agents alive (0, 1, 2, 3, 4)")
        made.wait_for_tree()
        made.wait_for_a_recruit()
        rows, totals = made.end()
        check_the_operators_books(rows, totals)
        assert totals["lost"] == 0
        assert max(float(row["rate_1s_hz"]) for row in rows) > 0
        assert max(int(row["agents_alive"]) for row in rows) == len(AGENTS)
        assert [agent["alive"] for agent in totals["agents"].values()] == [True] * len(AGENTS)


def test_it_is_so_where_a_fifth_is_lost_and_all_is_late(tmp_path: Path) -> None:
    """20 % of what each machine sends is lost, and the rest comes 50 ms later."""
    with field(tmp_path, delay_s=0.05, loss=0.2) as made:
        made.wait_for_tree()
        made.wait_for_a_recruit()
        made.operator_says("5 agents alive (0, 1, 2, 3, 4)")
        check_the_operators_books(*made.end())


def test_a_board_whose_link_was_down_is_taken_back(tmp_path: Path) -> None:
    """For 60 s of its time nobody hears it: it is given up, and alive and in the tree again afterwards."""
    cut = 3
    with field(tmp_path) as made:
        made.wait_for_tree()
        before = len(made.said)
        made.net.cut(cut)
        off = made.listener.frames[ROOT] + round(OFF_S)
        made.wait_for_tree(without=frozenset({cut}))
        made.operator_says(f"agent {cut} is gone", before)
        made.listener.wait_for(lambda: made.listener.frames[ROOT] >= off, f"{OFF_S} s", WITHIN_S)
        made.net.mend(cut)
        made.operator_says(f"agent {cut} is present", before)
        made.wait_for_tree()
        _, totals = made.end()
        assert totals["agents"][str(cut)]["absences"] == 1
        assert totals["agents"][str(cut)]["restarts"] == 0
