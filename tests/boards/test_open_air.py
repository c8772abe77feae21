"""Boards in open air: real processes on loopback that speak to their neighbours, and nothing stands between."""

import math
import os
import resource
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Any

import msgpack
import pytest
from mcap.reader import make_reader

from deltaswarm_orchestrator.processes import certificates
from deltaswarm_wire.envelope import Sample, encode_sample
from tests.support.boards import tls_table
from tests.support.fields import EVENT_AT, RUN, Listener, board_table, boards, endpoint, free_port, listening
from tests.support.soak import resident_mb
from tests.support.swarms import PATIENCE_S, stat, wait_until

pytestmark = pytest.mark.processes

MAX_MB = 40.0 if sys.version_info < (3, 13) else 44.0
"""Python 3.13 itself takes 3 MB more."""

FAST = ("--accelerate", "20")
OUTSIDE = ((10.0, 0.5), (19.0, 18.0))
"""Where agents begin that are to come newly into range of the root in the middle."""


def three(folder: Path, **air: Any) -> tuple[list[dict[str, Any]], list[str]]:
    """Three boards, each connected to those before it; the first stands at the event."""
    ports = [free_port() for _ in range(3)]
    tables = []
    for agent, at in enumerate((EVENT_AT, *OUTSIDE)):
        links = {"listen": [endpoint(ports[agent])], "connect": [endpoint(port) for port in ports[:agent]], **air}
        tables.append(board_table(agent, at, links, folder))
    return tables, [endpoint(port) for port in ports]


def wait_for_tree(listener: Listener, root: int = 0, members: set[int] | None = None) -> None:
    wanted = {1, 2} if members is None else members
    listener.wait_for(lambda: listener.table(root) == wanted, f"a tree of {wanted} below {root}")


def test_boards_that_start_apart_form_a_tree_and_report(tmp_path: Path) -> None:
    """Each has its own steps and its own clock; the operator's side sees who lives, and reports with their times.

    A step takes at most 20 ms of the processor, and a recording holds what a board said and heard.
    """
    tables, endpoints = three(tmp_path)
    tables[0]["log"] = {"folder": str(tmp_path / "logs"), "record": "mcap"}
    with boards(tmp_path) as running, listening(*endpoints) as listener:
        first = running.start(tables[0], *FAST)
        listener.wait_for(lambda: listener.path(0) == (0,), "a root, before another can be one")
        listener.wait_for_frames(0, 5)
        frames, used_s = listener.frames[0], busy_s(first.pid)
        listener.wait_for_frames(0, 60)
        assert (busy_s(first.pid) - used_s) / (listener.frames[0] - frames) <= 0.02
        running.start(tables[1], *FAST)
        listener.wait_for(lambda: listener.table(0) == {1}, "the second board below the first")
        running.start(tables[2], *FAST)
        wait_for_tree(listener)
        assert listener.alive == {0, 1, 2}
        wait_until(lambda: any(report.followers == 2 for report, _ in listener.reports), "a report with both")
        report, sent = next((report, sent) for report, sent in listener.reports if report.followers == 2)
        assert (report.agent, report.role, report.events[0].event) == (0, "root", 1)
        assert math.dist((report.x_m, report.y_m), EVENT_AT) < 1.0
        assert abs(msgpack.unpackb(sent) - time.time()) < PATIENCE_S

        assert running.stop(2) == 0
        listener.wait_for(lambda: 2 not in listener.alive, "the end of the third board's token")
        wait_for_tree(listener, members={1})
        assert [running.stop(agent) for agent in (0, 1)] == [0, 0]
    assert "stopped by SIGTERM" in (tmp_path / "logs" / "agent-0.log").read_text()
    with (tmp_path / "logs" / "agent-0.mcap").open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    assert topics == {"/agent/0/radio", "/agent/0/report", "/agent/1/radio", "/agent/2/radio"}


def test_the_senders_place_can_stand_in_for_distance(tmp_path: Path) -> None:
    """With a range of 1 m nobody hears anybody: the others stay out of the first one's tree."""
    tables, endpoints = three(tmp_path, range_m=1.0)
    for table in tables:
        table["log"] = {"every_s": 5.0}
    with boards(tmp_path) as running, listening(*endpoints) as listener:
        for table in tables:
            running.start(table, *FAST)
        wait_until(lambda: "out of range" in running.said(1) and "out of range" in running.said(2), "dropped frames")
        assert "heard 0;" in running.said(1)
        assert listener.table(0) == set()


def test_a_client_starts_without_its_router_and_finds_it_again(tmp_path: Path) -> None:
    """The agent steps on alone, is on the air whenever there is a router, and says when its link came and went."""
    import zenoh

    port = free_port()
    table = board_table(0, EVENT_AT, {"mode": "client", "connect": [endpoint(port)]}, tmp_path)
    config = zenoh.Config()
    config.insert_json5("transport/shared_memory/enabled", "false")
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["{endpoint(port)}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    with boards(tmp_path) as running:
        running.start(table, *FAST)
        wait_until(lambda: "first step" in running.said(0), "a first step without a router")
        for links in (1, 2):
            with zenoh.open(config) as session:
                listener = Listener(session)
                listener.wait_for_frames(0, 3)
                assert listener.alive == {0}
                wait_until(lambda links=links: running.said(0).count("links: 1 (was 0)") == links, "word of the link")
            wait_until(lambda links=links: running.said(0).count("links: 0 (was 1)") == links, "word of its end")
        assert running.stop(0) == 0


def test_a_port_that_is_taken_is_told(tmp_path: Path) -> None:
    """Once; the board is on the air all the same, and reaches others by what it connects to."""
    port = free_port()
    with boards(tmp_path) as running:
        running.start(board_table(0, EVENT_AT, {"listen": [endpoint(port)]}, tmp_path))
        wait_until(lambda: "is on the air" in running.said(0), "the first board")
        air = {"listen": [endpoint(port)], "connect": [endpoint(port)]}
        running.start(board_table(1, EVENT_AT, air, tmp_path))
        wait_until(lambda: "links: 1 " in running.said(1), "the second board's link")
        assert "cannot listen" not in running.said(0)
        assert running.said(1).count(f"cannot listen on {endpoint(port)}") == 1


def test_a_board_that_is_alone_or_frozen_comes_back(tmp_path: Path) -> None:
    """A board stopped for a while takes its steps up where they are due: it makes up for none."""
    tables, endpoints = three(tmp_path)
    for table in tables:
        table["log"] = {"every_s": 5.0}
    with boards(tmp_path) as running, listening(*endpoints) as listener:
        for table in tables:
            running.start(table, *FAST)
            listener.wait_for(lambda: listener.path(0) == (0,), "a root, before another can be one")
        wait_for_tree(listener)
        running.processes[1].send_signal(signal.SIGSTOP)
        listener.wait_for(lambda: listener.table(0) == {2}, "the frozen one's absence")
        frames = listener.frames[1]
        running.processes[1].send_signal(signal.SIGCONT)
        wait_until(lambda: "skipped 0" not in running.said(1).splitlines()[-1], "skipped steps in its log")
        listener.wait_for_frames(1, 5)
        assert listener.frames[1] - frames < listener.frames[0]
        wait_for_tree(listener)


def test_rubbish_on_the_air_is_counted_and_dropped(tmp_path: Path) -> None:
    """Frames that are malformed, too long or on no agent's key reach no agent; its own do not come back to it."""
    port = free_port()
    table = board_table(0, EVENT_AT, {"listen": [endpoint(port)]}, tmp_path)
    with boards(tmp_path) as running, listening(endpoint(port)) as listener:
        running.start(table, *FAST)
        listener.wait_for_frames(0, 3)
        key = f"deltaswarm/{RUN}/agent/{{}}/radio"
        good = encode_sample(Sample(3, b"here"))
        for agent, data in ((7, b"\xc1"), (7, bytes(9000)), ("x", good), (0, good)):
            listener.session.put(key.format(agent), data)
        for reason in ("malformed", "oversized", "on no agent's key", "from another agent with this number"):
            wait_until(lambda reason=reason: f": {reason}" in running.said(0), f"word of {reason}")
        assert running.stop(0) == 0
        told = "1 from another agent with this number, 1 malformed, 1 on no agent's key, 1 oversized;"
        assert told in running.said(0)


def test_systemd_is_told(tmp_path: Path) -> None:
    """Ready after the first step, alive while the loop goes round, stopping at the end."""
    table = board_table(0, EVENT_AT, {"listen": [endpoint(free_port())]}, tmp_path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd, boards(tmp_path) as running:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "200000"}
        running.start(table, environment=environment)
        told = [systemd.recv(1000).decode() for _ in range(8)]
        assert "READY=1" in told
        assert told.count("WATCHDOG=1") >= 6
        running.processes[0].terminate()
        while told[-1] != "STOPPING=1":
            told.append(systemd.recv(1000).decode())
        assert running.processes[0].wait(PATIENCE_S) == 0


def test_a_board_is_quick_to_start_and_stays_small(tmp_path: Path) -> None:
    """From the start of the process to its first step, below a second of the processor; at most 40 MB resident."""
    table = board_table(0, EVENT_AT, {"listen": [endpoint(free_port())]}, tmp_path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd, boards(tmp_path) as running:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        process = running.start(table, environment={"NOTIFY_SOCKET": str(tmp_path / "notify")})
        assert systemd.recv(1000) == b"READY=1"
        assert busy_s(process.pid) < 1.0  # of wall time a loaded machine may take more
        wait_until(lambda: "is on the air" in running.said(0), "a session")
        assert resident_mb(process.pid) <= MAX_MB


def test_so_does_a_board_with_certificates_that_knows_25_agents(tmp_path: Path) -> None:
    certificates.make(tmp_path, range(3), [], 1)
    listen = f"tls/127.0.0.1:{free_port()}"
    with boards(tmp_path) as running:
        for agent in range(3):
            link = {"connect": [listen]} if agent else {"listen": [listen]}
            air = {**link, "agents": "0-24", "tls": tls_table(tmp_path, f"agent-{agent}", verify_name=False)}
            running.start(board_table(agent, EVENT_AT, air, tmp_path))
        wait_until(lambda: "links: 2 " in running.said(0), "both links")
        assert resident_mb(running.processes[0].pid) <= MAX_MB


def busy_s(pid: int) -> float:
    fields = stat(pid)
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_a_disk_that_is_full_ends_the_recording_and_not_the_agent(tmp_path: Path) -> None:
    port = free_port()
    table = board_table(0, EVENT_AT, {"listen": [endpoint(port)]}, tmp_path)
    table["log"] = {"folder": str(tmp_path / "logs"), "record": "mcap"}
    with boards(tmp_path) as running, listening(endpoint(port)) as listener:
        process = running.start(table, "--accelerate", "400")
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (50_000, 50_000))
        wait_until(lambda: "recording stopped" in running.said(0), "word of the disk")
        listener.wait_for_frames(0, 50)
        assert running.stop(0) == 0
        assert running.said(0).count("recording stopped") == 1
