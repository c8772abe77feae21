"""A client that does not read loses its link; the run goes on, and operator and recorder keep theirs."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
import zenoh

from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.access import user_name
from deltaswarm_wire.keys import AGENT, FRAME, OPERATOR, RECORDER, Keys
from deltaswarm_wire.session import RouterLink, client_pairs, configured
from deltaswarm_world.io.slow_links import DESCRIPTORS, PATIENCE_S, SlowLinks, trusted_sessions
from deltaswarm_world.io.transport import open_router
from tests.hostile.attacker import WHO
from tests.support.swarms import BOUND_S, started, wait_for_end, wait_until
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

RUN = "slow"
KEYS = Keys(RUN)
LINKS = ("low-latency", "ordinary")
STEPS = 1000
NEVER_CLOSE = ("transport/link/tx/queue/congestion_control/block/wait_before_close", "600000000")
"""Zenoh itself closes an ordinary link after so long [us]."""
SMALL_BUFFERS = (("transport/link/tcp/so_sndbuf", "4096"),)
"""So that a link is full after a few dozen frames and not after thousands."""


@contextmanager
def slow_reader(*arguments: str) -> Iterator[None]:
    """The process of such a client, which has subscribed: endpoint, user, password, key, link."""
    command = [sys.executable, "-m", "tests.hostile.slow_reader", *arguments]
    with subprocess.Popen(command, cwd=Path(__file__).parents[2], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline()
            yield
        finally:
            process.kill()


def play(folder: Path, link: str = "") -> tuple[dict[str, Any], str]:
    """The world's totals and log after a run, with a slow reader over such a link."""
    scenario = load_scenario(
        "smoke", [f"run.duration_s={STEPS}", "run.ask_every_step=true", "run.step_timeout_s=60", "record=off"]
    )
    folder.mkdir()
    # no step begins before the last agent is there, and it comes after the reader
    everyone = range(scenario.agents.count)
    with started(scenario, RUN, folder, everyone[:-1], zenoh=SMALL_BUFFERS) as (swarm, observer):
        if not link:
            return _finish(swarm, observer, everyone[-1], folder)
        name = user_name(AGENT, WHO)
        with slow_reader(swarm.endpoint, name, swarm.password(name), KEYS.agent(WHO, FRAME), link):
            return _finish(swarm, observer, everyone[-1], folder)


def _finish(swarm: Swarm, observer: Observer, last: int, folder: Path) -> tuple[dict[str, Any], str]:
    swarm.start_agents([last])
    wait_for_end(swarm, observer, BOUND_S)
    return run_tables.read_outcome(folder).world, (folder / "logs" / "world-0.log").read_text()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return play(tmp_path_factory.mktemp("undisturbed") / "run")[0]


@pytest.mark.parametrize("link", first_of(LINKS))
def test_a_client_that_does_not_read_stops_nobody(link: str, undisturbed: dict[str, Any], tmp_path: Path) -> None:
    """It gets an agent's frames in a second session: the run goes on, and all agents do what they did without it."""
    world, log = play(tmp_path / "run", link)
    assert world["digest"] == undisturbed["digest"]
    assert log.count("does not read what it is sent") == 1
    assert "goes on without" not in log


@pytest.mark.parametrize("link", first_of(LINKS))
def test_operator_and_recorder_are_not_cut(link: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The world knows them by their sessions' ids: their links are full for longer, but only the agent's is cut."""
    credentials = tmp_path / "credentials"
    users = {OPERATOR: KEYS.clock, RECORDER: KEYS.clock, user_name(AGENT, WHO): KEYS.agent(WHO, FRAME)}
    credentials.write_text("".join(f"{user}:secret\n" for user in users))
    router = RouterLink("tcp/127.0.0.1:0", overrides=(*SMALL_BUFFERS, NEVER_CLOSE))
    session, endpoints = open_router(router, str(credentials), KEYS, range(WHO + 1), [router.endpoint])
    with ExitStack() as stack:
        stack.enter_context(session)
        stack.callback(SlowLinks(session, trusted_sessions(credentials.read_text()), lambda: "").close)
        for user, key in users.items():
            stack.enter_context(slow_reader(endpoints[0], user, "secret", key, link))
        to_both = Feeder(session, KEYS.clock)
        wait_until(lambda: to_both.blocked_s > PATIENCE_S + 1, "full links")
        assert "is cut" not in caplog.text
        Feeder(session, KEYS.agent(WHO, FRAME))
        wait_until(lambda: "is cut" in caplog.text, "the cut")
        assert caplog.text.count("is cut") == 1
        assert to_both.blocked_s > PATIENCE_S + 1


def test_links_that_come_and_go_leave_no_descriptor(tmp_path: Path) -> None:
    """Each is looked for among all descriptors of the process, of which most are no links."""
    credentials = tmp_path / "credentials"
    credentials.write_text(f"{OPERATOR}:secret\n")
    router = RouterLink("tcp/127.0.0.1:0")
    session, endpoints = open_router(router, str(credentials), KEYS, range(1), [router.endpoint])
    with session:
        links = SlowLinks(session, trusted_sessions(credentials.read_text()), lambda: "")
        before = len(os.listdir(DESCRIPTORS))
        client = RouterLink(endpoints[0], OPERATOR, "secret")
        for _ in range(10):
            with zenoh.open(configured(zenoh.Config, client_pairs(client), client)):
                wait_until(lambda: links._watched, "the link")
            wait_until(lambda: not links._watched, "its end")
        assert len(os.listdir(DESCRIPTORS)) == before
        links.close()


@pytest.mark.parametrize("link", first_of(LINKS))
def test_a_link_that_was_there_before_does_no_harm(link: str, tmp_path: Path) -> None:
    """As that of a board that knows the port."""
    credentials = tmp_path / "credentials"
    credentials.write_text(f"{OPERATOR}:secret\n")
    router = RouterLink("tcp/127.0.0.1:0")
    session, endpoints = open_router(router, str(credentials), KEYS, range(1), [router.endpoint])
    with session, slow_reader(endpoints[0], OPERATOR, "secret", KEYS.clock, link):
        SlowLinks(session, trusted_sessions(credentials.read_text()), lambda: "").close()


class Feeder:
    """Sends on a key until a link is full, and waits then."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        self._sent_at = time.monotonic()
        threading.Thread(target=self._feed, daemon=True).start()

    @property
    def blocked_s(self) -> float:
        return time.monotonic() - self._sent_at

    def _feed(self) -> None:
        with suppress(zenoh.ZError):  # the session is closed
            while True:
                self._publisher.put(bytes(1000))
                self._sent_at = time.monotonic()
