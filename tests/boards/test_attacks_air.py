"""Boards and an operator in open air under attack: by floods, altered bytes, wrong certificates and wrong clocks."""

import datetime
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_operator.core.presence import INSISTS, RECENT, RESTART_S
from deltaswarm_orchestrator.processes import certificates
from deltaswarm_orchestrator.processes.certificates import Authority
from deltaswarm_wire.codec import pack
from deltaswarm_wire.envelope import Sample, Sent, encode_sample, encode_sent
from deltaswarm_wire.keys import RADIO, REPORT, Keys
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import MAX_REPORTED, Report, encode_report
from tests.boards.test_identity import TRUE, board, listen, opened
from tests.support.boards import tls_arguments, tls_table
from tests.support.cable import cable
from tests.support.fields import EVENT_AT, RUN, board_table, boards, endpoint, free_port
from tests.support.soak import resident_mb
from tests.support.swarms import PATIENCE_S, wait_until
from tests.unit.operator.test_open_air import operating

pytestmark = pytest.mark.processes

KEYS = Keys(RUN)
PER_S = 20
FAST = ("--accelerate", str(PER_S))


@contextmanager
def flooding(to: str, keys: Sequence[str], samples: Sequence[tuple[bytes, bytes]]) -> Iterator[None]:
    command = [sys.executable, "-m", "tests.support.flooder", to, *keys]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2])
    try:
        assert process.stdin is not None
        process.stdin.write("".join(f"{data.hex()} {sent.hex()}\n" for data, sent in samples) + "\n")
        process.stdin.flush()
        yield
        process.stdin.close()
        assert process.wait(PATIENCE_S) == 0
    finally:
        process.kill()
        process.wait()


def tls_air(folder: Path, name: str, **air: Any) -> dict[str, Any]:
    return {**air, "tls": tls_table(folder, name, verify_name=False)}


def test_a_neighbour_that_floods_its_key_stops_no_board(tmp_path: Path) -> None:
    """The board goes on with its steps; the excess is counted, told once per sender, and takes no memory."""
    port = free_port()
    table = board_table(0, EVENT_AT, {"listen": [endpoint(port)]}, tmp_path)
    table["agent"] = {**table["agent"], "step_s": 0.1}
    table["log"] = {"every_s": 1.0}
    frames = [
        (encode_sample(Sample(number, bytes(size))), encode_sent(Sent(1.0, 2.0, 3.0)))
        for number, size in ((5, 9), (6, 8000))
    ]
    too_many = "radio: over 200 per second"
    with boards(tmp_path) as running:
        process = running.start(table)
        wait_until(lambda: "is on the air" in running.said(0), "the board")
        with flooding(endpoint(port), [KEYS.agent(agent, RADIO) for agent in (7, 8)], frames):
            wait_until(lambda: running.said(0).count(too_many) == 2, "word of both")
            lines = running.said(0).count(", step ")
            wait_until(lambda: running.said(0).count(", step ") >= lines + 3, "three seconds of steps")
            assert resident_mb(process.pid) <= 120.0
        assert running.stop(0) == 0
        assert running.said(0).count(too_many) == 2
        assert "over 200 per second" in running.said(0).splitlines()[-1]


@pytest.mark.slow
def test_an_operator_that_is_flooded_counts_the_others(tmp_path: Path) -> None:
    """Of the one that floods much is refused or rejected, and named once; nobody else is, and memory stays bounded."""
    port = free_port()
    events = tuple(Event(number, 1.0, 2.0) for number in range(MAX_REPORTED))
    reports = [
        (encode_report(Report(7, sequence, 0, "root", 1.0, 2.0, 3, events)), pack(1e9 + sequence))
        for sequence in range(50)
    ]
    with operating(tmp_path, "--listen", endpoint(port), "--step-s", "2") as operator, boards(tmp_path) as running:
        running.start(board_table(0, EVENT_AT, {"connect": [endpoint(port)]}, tmp_path), *FAST)
        operator.wait_for("1 agents alive (0), ")
        with flooding(endpoint(port), [KEYS.agent(7, REPORT)], reports):
            operator.wait_for("on agent 7's key")
            lines = operator.said.count("1 agents alive (0), ")
            wait_until(lambda: operator.said.count("1 agents alive (0), ") >= lines + 3, "further steps")
            assert resident_mb(operator.process.pid) <= 300.0
        assert running.stop(0) == 0
        _, totals = operator.end()
    flooder = totals["per_sender"]["7"]
    assert flooder["rejected"] + totals["refused"] > 0
    assert set(totals["refused_on"]) <= {"agent 7's key"}
    assert (totals["per_sender"]["0"]["lost"], totals["per_sender"]["0"]["rejected"]) == (0, 0)
    assert totals["per_sender"]["0"]["messages"] > 0


def test_what_a_recording_repeats_under_the_boards_own_certificate_does_not_count(tmp_path: Path) -> None:
    """While the board itself reports; the operator says that two processes report as one agent."""
    certificates.make(tmp_path, range(3), [], 1)
    to, its_own = (f"tls/127.0.0.1:{free_port()}" for _ in range(2))
    arguments = ("--listen", to, "--agents", "0-2", *tls_arguments(tmp_path, "operator"))
    table = board_table(1, EVENT_AT, tls_air(tmp_path, "agent-1", connect=[to], listen=[its_own]), tmp_path)
    with ExitStack() as stack:
        operator = stack.enter_context(operating(tmp_path, *arguments))
        running = stack.enter_context(boards(tmp_path))
        running.start(table, *FAST)
        neighbour = stack.enter_context(opened(board(tmp_path, 2, "0-2", connect=[its_own])))
        heard: list[tuple[bytes, bytes]] = []
        neighbour.declare_subscriber(
            KEYS.agent(1, REPORT),
            lambda sample: heard.append((sample.payload.to_bytes(), sample.attachment.to_bytes())),
        )
        wait_until(lambda: len(heard) >= 2 * RECENT, "reports")
        thief = stack.enter_context(opened(board(tmp_path, 1, "0-2", connect=[to])))
        recorded = heard[:RECENT]
        for data, sent in recorded:  # at once
            thief.put(KEYS.agent(1, REPORT), data, attachment=sent)
        for data, sent in recorded[:20]:  # each between two of the board's own
            already = len(heard)
            wait_until(lambda already=already: len(heard) > already, "the next report")
            thief.put(KEYS.agent(1, REPORT), data, attachment=sent)
        operator.wait_for("report as agent 1")
        _, totals = operator.end()
        running.stop(1)
    assert totals["agents"]["1"]["stale"] >= RECENT
    assert totals["agents"]["1"]["reports"] < len(heard) + RECENT // 2, "its own, and few of the recorded"


def test_whoever_has_the_wrong_certificate_is_told_and_heard_by_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expired, not valid yet, of another authority, or another agent's: a warning at the start says which."""
    own, other = tmp_path / "own", tmp_path / "other"
    certificates.make(own, range(6), [], 1)
    certificates.make(other, [3], [], 1)
    certificates.write_pair(own / "agent-1", *Authority.load(own).sign("agent-1", days=-0.5))
    with monkeypatch.context() as patch:
        patch.setattr(certificates, "CLOCK_SLACK", datetime.timedelta(hours=-6))
        certificates.write_pair(own / "agent-2", *Authority.load(own).sign("agent-2", days=1))
    for ending in ("pem", "key"):
        (own / f"agent-3.{ending}").write_bytes((other / f"agent-3.{ending}").read_bytes())
        (own / f"agent-4.{ending}").write_bytes((own / f"agent-5.{ending}").read_bytes())
    wrong = {1: "certificate has expired", 2: "not yet valid", 3: "the other end would refuse it", 4: "agent-5"}
    to = f"tls/127.0.0.1:{free_port()}"
    arguments = ("--listen", to, "--agents", "0-4", *tls_arguments(own, "operator"))
    with operating(tmp_path, *arguments) as operator, boards(tmp_path) as running:
        for agent in range(5):
            running.start(board_table(agent, EVENT_AT, tls_air(own, f"agent-{agent}", connect=[to]), tmp_path), *FAST)
        operator.wait_for("1 agents alive (0), ")
        for agent, word in wrong.items():
            wait_until(lambda agent=agent: "first step" in running.said(agent), f"agent {agent}")
            assert running.said(agent).count("air.tls.cert_file") == 1
            assert word in running.said(agent)
        assert "air.tls.cert_file" not in running.said(0)
        _, totals = operator.end()
    assert set(totals["agents"]) == {"0"}


@pytest.mark.parametrize("protocol", ["tls", "tcp"])
def test_over_tls_nothing_is_altered_on_the_way(protocol: str, tmp_path: Path) -> None:
    """A changed byte ends the link, and the next one is sound. Over TCP it arrives, as the page says."""
    certificates.make(tmp_path, [0, 3], [], 1)
    port = free_port()
    air: dict[str, Any] = {"listen": [f"{protocol}/127.0.0.1:{port}"]}
    key, sound, mark = KEYS.agent(3, RADIO), b"sound " * 50, b"mark"
    with ExitStack() as stack:
        hears = stack.enter_context(opened(board(tmp_path, 0, **air)))
        heard = listen(hears, KEYS.all_radio)
        link = stack.enter_context(cable(port))
        speaks = stack.enter_context(opened(board(tmp_path, 3, connect=[f"{protocol}/127.0.0.1:{link.port}"])))
        wait_until(lambda: speaks.put(key, mark) or (key, mark) in heard, "a link")
        link.alter(b"sound", b"false")
        wait_until(lambda: speaks.put(key, sound) or link.altered, "something altered")
        link.alter(b"", b"")
        wait_until(lambda: speaks.put(key, TRUE) or (key, TRUE) in heard, "a sound link")
    assert any(b"false" in data for _, data in heard) == (protocol == "tcp")
    assert {data for _, data in heard} <= {mark, sound, TRUE} or protocol == "tcp"


WRONG_CLOCK = """
import os, time
real = time.time
time.time = lambda: real() + float(os.environ["CLOCK_OFF_S"])
"""


def test_a_board_whose_clock_is_an_hour_off_is_heard(tmp_path: Path) -> None:
    """Ahead, and after a restart an hour behind: its reports count again within 1.5 s, and nothing seems lost."""
    port = free_port()
    (tmp_path / "sitecustomize.py").write_text(WRONG_CLOCK)
    table = board_table(0, EVENT_AT, {"connect": [endpoint(port)]}, tmp_path)
    with operating(tmp_path, "--listen", endpoint(port)) as operator, boards(tmp_path) as running:

        def reports_with_a_clock_off(by_s: int, count: int) -> None:
            environment = {"PYTHONPATH": str(tmp_path), "CLOCK_OFF_S": str(by_s)}
            running.start(table, *FAST, environment=environment)
            already = messages()
            wait_until(lambda: messages() >= already + count, "reports")
            assert running.stop(0) == 0

        def messages() -> int:
            lines = [line for line in operator.said.splitlines() if " in all, " in line]
            return int(lines[-1].rpartition(" in all, ")[0].rpartition(" ")[2]) if lines else 0

        for off_s in (3600, -3600):
            reports_with_a_clock_off(off_s, 20)
        _, totals = operator.end()
    assert (totals["lost"], totals["rejected"], totals["agents"]["0"]["absences"]) == (0, 0, 2)
    assert totals["agents"]["0"]["stale"] < INSISTS + RESTART_S * PER_S
