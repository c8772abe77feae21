"""A world for an operator's process: a router as the real one opens it, and the few things that it says."""

import csv
import json
import os
import queue
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Self, cast

from deltaswarm_wire.access import user_name
from deltaswarm_wire.keys import AGENT, OPERATOR, WORLD, Keys
from deltaswarm_wire.operator_messages import (
    Clock,
    Forwarded,
    Report,
    Workload,
    decode_workload,
    encode_clock,
    encode_forwarded,
)
from deltaswarm_wire.orders import decode_taken
from deltaswarm_wire.session import PASSWORD_VARIABLE, RouterLink, configured, router_pairs, use_one_worker_thread
from tests.support.fields import free_port
from tests.support.swarms import PATIENCE_S

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

AGENTS = 4
KEYS = Keys("test")
USERS = [OPERATOR, *(user_name(AGENT, agent) for agent in range(AGENTS))]


def report(agent: int, sequence: int, step: int) -> Report:
    return Report(agent, sequence, step, "root", 1.0, 2.0, 3, ())


def fast(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)


def wait_until_heard(publisher: zenoh.Publisher) -> None:
    heard = threading.Event()
    listener = publisher.declare_matching_listener(lambda status: heard.set() if status.matching else None)
    status = cast(zenoh.MatchingStatus, publisher.matching_status)  # its own stub says bool
    assert status.matching or heard.wait(PATIENCE_S)
    listener.undeclare()


class World:
    """A router as the world opens it, and the few things a world says to an operator."""

    def __init__(self, folder: Path) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.out = folder / "out"
        self.log = folder / "operator.log"
        credentials = folder / "credentials"
        credentials.write_text("".join(f"{user}:secret of {user}\n" for user in USERS))
        link = RouterLink(self.endpoint)
        pairs = router_pairs(link, str(credentials), KEYS, range(AGENTS))
        self.session = zenoh.open(configured(zenoh.Config, pairs, link))
        self.token = self.session.liveliness().declare_token(KEYS.token(WORLD))
        self.clock = fast(self.session, KEYS.clock)
        self._forwarded = fast(self.session, KEYS.forwarded)
        self._handed_on = 0
        self.taken: queue.SimpleQueue[int] = queue.SimpleQueue()
        """Steps that the operator has confirmed."""
        self._confirmed = self.session.declare_subscriber(
            KEYS.all_taken, lambda sample: self.taken.put(decode_taken(sample.payload.to_bytes()))
        )
        self.tokens: queue.Queue[zenoh.SampleKind] = queue.Queue()
        self._watch = self.session.liveliness().declare_subscriber(
            KEYS.token(OPERATOR), lambda sample: self.tokens.put(sample.kind), history=True
        )
        self._started: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._started:
            process.kill()
            process.wait()
        self.session.close()

    def start_operator(
        self, *arguments: str, password: str = f"secret of {OPERATOR}", piped: bool = False
    ) -> subprocess.Popen[bytes]:
        """Start it as a user would by hand; its log goes to a file, or to a pipe."""
        command = [sys.executable, "-P", "-m", "deltaswarm_operator", "--run", KEYS.run, "--connect", self.endpoint]
        with self.log.open("wb") as log:
            process = subprocess.Popen(
                [*command, "--out", str(self.out), *arguments],
                env={**os.environ, PASSWORD_VARIABLE: password},
                stderr=subprocess.PIPE if piped else log,
            )
        self._started.append(process)
        return process

    def running_operator(self, *arguments: str) -> subprocess.Popen[bytes]:
        """Start it, and wait until it hears what this says."""
        process = self.start_operator(*arguments)
        self.wait_for_operator()
        wait_until_heard(self.clock)
        return process

    def kill(self, process: subprocess.Popen[bytes]) -> None:
        """End an operator by SIGKILL, and wait until its token is gone."""
        process.kill()
        process.wait()
        assert self.tokens.get(timeout=PATIENCE_S) == zenoh.SampleKind.DELETE

    def wait_until_taken(self, step: int) -> None:
        """Until the operator has confirmed a step."""
        while self.taken.get(timeout=PATIENCE_S) < step:
            pass

    def workloads(self) -> "queue.SimpleQueue[Workload]":
        """What operators publish of the workload from now on."""
        seen: queue.SimpleQueue[Workload] = queue.SimpleQueue()
        self._workloads = self.session.declare_subscriber(
            KEYS.workload, lambda sample: seen.put(decode_workload(sample.payload.to_bytes()))
        )
        return seen

    def wait_for_operator(self) -> None:
        """Until its token is there."""
        assert self.tokens.get(timeout=PATIENCE_S) == zenoh.SampleKind.PUT

    def close_step(self, step: int, last: bool = False) -> None:
        """Send the clock."""
        self.clock.put(encode_clock(Clock(step, float(step), last)))

    def hand_on(self, data: bytes, step: int = 0, skipped: int = 0, number: int | None = None) -> None:
        """Hand a report on to the operator, by default as the next one; some before it were lost."""
        number = self._handed_on + skipped if number is None else number
        self._forwarded.put(encode_forwarded(Forwarded(number, step, data)))
        self._handed_on = number + 1

    def rows(self) -> list[Workload]:
        """The operator's table."""
        with (self.out / "operator.csv").open(newline="") as stream:
            return [
                Workload(*(hint(row[name]) for name, hint in Workload.__annotations__.items()))
                for row in csv.DictReader(stream)
            ]

    def totals(self) -> dict[str, Any]:
        """The operator's totals."""
        return dict(json.loads((self.out / "operator.json").read_text()))
