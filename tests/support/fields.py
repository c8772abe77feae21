"""Boards for tests: real processes in open air on loopback, and a plain Zenoh session that listens to them."""

import os
import signal
import socket
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from random import SystemRandom
from typing import Any

import tomli_w

from deltaswarm_agent.controllers.paper.frames import Member, PaperFrame, Relocating, decode
from deltaswarm_wire.envelope import decode_sample
from deltaswarm_wire.keys import Keys, parse_agent_key, parse_token
from deltaswarm_wire.operator_messages import Report, decode_report
from deltaswarm_wire.session import use_one_worker_thread
from tests.support.swarms import PATIENCE_S, wait_until

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

RUN = "boards"
EVENT_AT = (10.0, 10.0)
"""In the middle of the arena, where the one event is."""

TASK: dict[str, Any] = {
    "width_m": 20.0,
    "height_m": 20.0,
    "range_m": 9.0,
    "control": {"mode": "hierarchical", "rho": 1, "d_min_m": 3.0, "gamma_max": 100_000},
}


def free_port() -> int:
    """A port that nobody listens on now, and that no other test gets from the kernel before it is used."""
    while True:
        port = SystemRandom().randrange(10_000, 32_768)  # below those that the kernel gives away
        with socket.socket() as found, suppress(OSError):
            found.bind(("127.0.0.1", port))
            return port


def endpoint(port: int) -> str:
    return f"tcp/127.0.0.1:{port}"


def board_table(agent: int, at: tuple[float, float], air: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A board's settings: a kinematic body, with one event in the middle that never ends."""
    events = folder / "events.csv"
    events.write_text("event,x_m,y_m\n1,{},{}\n".format(*EVENT_AT))
    return {
        "id": agent,
        "run": RUN,
        "agent": TASK,
        "air": dict(air),
        "body": {"kind": "kinematic", "options": {"x_m": at[0], "y_m": at[1], "events": str(events)}},
    }


class Boards:
    """Boards under way, by the agents' numbers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: dict[int, subprocess.Popen[str]] = {}

    def start(
        self,
        table: Mapping[str, Any],
        *arguments: str,
        environment: Mapping[str, str] | None = None,
        inside: Sequence[str] = (),
    ) -> subprocess.Popen[str]:
        """One board by its settings; `inside` is the command that runs another one elsewhere."""
        agent = table["id"]
        file = self.folder / f"board-{agent}.toml"
        file.write_text(tomli_w.dumps(table))
        with (self.folder / f"board-{agent}.err").open("a") as errors:
            process = subprocess.Popen(
                [*inside, sys.executable, "-m", "deltaswarm_board", str(file), *arguments],
                stdout=subprocess.DEVNULL,
                stderr=errors,
                text=True,
                env={**os.environ, **(environment or {})},
            )
        self.processes[agent] = process
        return process

    def said(self, agent: int) -> str:
        """What a board has written to standard error."""
        return (self.folder / f"board-{agent}.err").read_text()

    def stop(self, agent: int) -> int:
        """SIGTERM, and the exit code."""
        process = self.processes.pop(agent)
        process.terminate()
        try:
            return process.wait(PATIENCE_S)
        finally:
            process.kill()
            process.wait()


@contextmanager
def boards(folder: Path) -> Iterator[Boards]:
    """Boards of which none is left afterwards."""
    made = Boards(folder)
    try:
        yield made
    finally:
        for process in made.processes.values():
            process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait()


class Listener:
    """A plain Zenoh peer that hears all radio frames and reports, and sees who is alive."""

    def __init__(self, session: zenoh.Session) -> None:
        self.radio: dict[int, PaperFrame] = {}
        self.frames: Counter[int] = Counter()
        self.reports: list[tuple[Report, bytes]] = []
        self.alive: set[int] = set()
        self.moved: dict[int, tuple[float, float]] = {}
        """Where each recruited leaf was when it was first heard to be on its way [m]."""
        self.session = session
        keys = Keys(RUN)
        self._lock = threading.Lock()
        self._subscribers = [
            session.declare_subscriber(keys.all_radio, self._on_radio),
            session.declare_subscriber(keys.all_reports, self._on_report),
            session.liveliness().declare_subscriber(keys.all_tokens, self._on_token, history=True),
        ]

    def _on_radio(self, sample: zenoh.Sample) -> None:
        source = parse_agent_key(str(sample.key_expr))
        assert source is not None
        frame = decode(source[0], decode_sample(sample.payload.to_bytes()).payload)
        self.radio[source[0]] = frame
        self.frames[source[0]] += 1
        if type(frame) is Relocating:
            self.moved.setdefault(source[0], (frame.x_cm / 100, frame.y_cm / 100))

    def _on_report(self, sample: zenoh.Sample) -> None:
        assert sample.attachment is not None
        self.reports.append((decode_report(sample.payload.to_bytes()), sample.attachment.to_bytes()))

    def _on_token(self, sample: zenoh.Sample) -> None:
        source = parse_token(str(sample.key_expr))
        assert source is not None
        if sample.kind == zenoh.SampleKind.PUT:
            self.alive.add(source[1])
        else:
            self.alive.discard(source[1])

    def path(self, agent: int) -> tuple[int, ...]:
        """An agent's path, by its last frame; empty if that was no member's."""
        frame = self.radio.get(agent)
        return frame.path if type(frame) is Member else ()

    def table(self, agent: int) -> set[int]:
        """Who is below an agent, by its last frame."""
        frame = self.radio.get(agent)
        return {row.agent for row in frame.table} if type(frame) is Member else set()

    def wait_for_frames(self, agent: int, count: int) -> None:
        """So many more of an agent's frames."""
        wanted = self.frames[agent] + count
        wait_until(lambda: self.frames[agent] >= wanted, f"{count} frames of agent {agent}")

    def wait_for(self, condition: Callable[[], Any], what: str, within_s: float = PATIENCE_S) -> None:
        """A condition on what was heard."""
        try:
            wait_until(condition, what, within_s)
        except AssertionError as error:
            raise AssertionError(f"{error}; last heard: {self.radio}") from None


def plain_peer(*endpoints: str) -> zenoh.Config:
    """Of a session that connects to boards, whether they are there yet or not."""
    config = zenoh.Config()
    for key, value in (
        ("mode", '"peer"'),
        ("connect/endpoints", str(list(endpoints)).replace("'", '"')),
        ("connect/exit_on_failure", "false"),
        ("connect/timeout_ms", "-1"),
        ("connect/retry", '{"period_init_ms": 100, "period_max_ms": 200, "period_increase_factor": 1}'),
        ("listen/endpoints", "[]"),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        ("transport/shared_memory/enabled", "false"),
    ):
        config.insert_json5(key, value)
    return config


@contextmanager
def listening(*endpoints: str) -> Iterator[Listener]:
    """A listener that connects to boards, whether they are there yet or not."""
    with zenoh.open(plain_peer(*endpoints)) as session:
        yield Listener(session)
