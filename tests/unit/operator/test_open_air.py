"""The operator without a world as a real process: peers and clients over loopback, TCP and TLS."""

import os
import queue
import resource
import signal
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from deltaswarm_operator.__main__ import main
from deltaswarm_operator.io.arrivals import (
    MAX_TOKENS,
    MAX_WAITING_BYTES_OF_ONE,
    SAMPLE_BYTES,
    ArrivalKind,
    BoundedArrivals,
)
from deltaswarm_operator.io.open_air_source import OpenAirConfig, OpenAirSource
from deltaswarm_operator.io.process import End, OperatorProcess
from deltaswarm_orchestrator.processes import certificates
from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_wire.codec import MAX_SAMPLE_BYTES
from deltaswarm_wire.session import RouterLink
from tests.support.airborne import operating
from tests.support.boards import tls_arguments, tls_table
from tests.support.fields import EVENT_AT, RUN, board_table, boards, endpoint, free_port
from tests.support.swarms import PATIENCE_S, wait_until

FAST = ("--accelerate", "20")


@pytest.mark.processes
@pytest.mark.parametrize("mode", ["peer", "router"])
def test_boards_report_to_an_operator_that_they_connect_to(mode: str, tmp_path: Path) -> None:
    """It sees who comes, who goes and who comes back, and its table has every report."""
    port = free_port()
    air = {"connect": [endpoint(port)], "mode": "client" if mode == "router" else "peer"}
    tables = [board_table(agent, (10.0 + agent, 10.0), air, tmp_path) for agent in range(2)]
    with operating(tmp_path, "--mode", mode, "--listen", endpoint(port)) as operator, boards(tmp_path) as running:
        for table in tables:
            running.start(table, *FAST)
        operator.wait_for("2 agents alive (0, 1), ")
        assert running.stop(1) == 0
        operator.wait_for("1 agents alive (0), ")
        running.start(tables[1], *FAST)
        wait_until(lambda: operator.said.count("agent 1 is present") == 2, "agent 1 is back")
        wait_until(lambda: operator.said.splitlines()[-1].count("2 agents alive"), "both, at last")
        assert [running.stop(agent) for agent in (0, 1)] == [0, 0]
        operator.wait_for("0 agents alive (nobody), ")
        rows, totals = operator.end()
    assert (totals["complete"], totals["end"], totals["rejected"]) == (True, End.STOPPED.value, 0)
    assert sum(int(row["messages"]) for row in rows) == totals["messages"] > 0
    assert sum(agent["reports"] for agent in totals["agents"].values()) == totals["messages"] + totals["held"]
    assert (totals["agents"]["1"]["absences"], totals["agents"]["0"]["absences"]) == (2, 1)
    assert {0, 1, 2} <= {int(row["agents_alive"]) for row in rows}


@pytest.mark.processes
@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGHUP])
def test_it_connects_to_boards_and_ends_on_an_interrupt(by: signal.Signals, tmp_path: Path) -> None:
    """They may come later than it does; a closed terminal is an end as well."""
    port = free_port()
    with operating(tmp_path, "--connect", endpoint(port)) as operator, boards(tmp_path) as running:
        operator.wait_for("0 agents alive (nobody), ")
        running.start(board_table(0, EVENT_AT, {"listen": [endpoint(port)]}, tmp_path), *FAST)
        operator.wait_for("1 agents alive (0), ")
        wait_until(lambda: ", 0 in all" not in operator.said.splitlines()[-1], "a report")
        _, totals = operator.end(by)
    assert totals["agents"]["0"]["reports"] > 0


@pytest.mark.processes
def test_over_tls_only_certified_boards_come_in(tmp_path: Path) -> None:
    """The second board's certificate is another authority's."""
    port = free_port()
    own, other = tmp_path / "own", tmp_path / "other"
    certificates.make(own, [0], [], 1)
    certificates.make(other, [1], [], 1)
    listen = f"tls/127.0.0.1:{port}"
    with (
        operating(tmp_path, "--listen", listen, *tls_arguments(own, "operator")) as operator,
        boards(tmp_path) as running,
    ):
        for agent, folder in ((1, other), (0, own)):
            tls = tls_table(folder, f"agent-{agent}") | {"ca_file": str(own / "ca.pem")}
            air = {"connect": [listen], "tls": tls}
            running.start(board_table(agent, EVENT_AT, air, tmp_path), *FAST)
        operator.wait_for("1 agents alive (0), ")
        wait_until(lambda: running.said(1).count("first step"), "the other board runs")
        _, totals = operator.end()
    assert set(totals["agents"]) == {"0"}


@pytest.mark.processes
def test_it_says_who_is_there_twice(tmp_path: Path) -> None:
    """Two boards with one number, each linked to it alone; none of their reports is lost."""
    port = free_port()
    folders = [tmp_path / name for name in ("first", "second")]
    with operating(tmp_path, "--listen", endpoint(port)) as operator, ExitStack() as stack:
        for folder in folders:
            folder.mkdir()
            board = board_table(3, EVENT_AT, {"connect": [endpoint(port)]}, folder)
            stack.enter_context(boards(folder)).start(board, *FAST)
        operator.wait_for("report as agent 3")
        operator.wait_for("1 agents alive (3), doubled (3), ")
        _, totals = operator.end()
    assert (totals["lost"], totals["agents"]["3"]["doubled"]) == (0, True)
    assert totals["agents"]["3"]["restarts"] <= 1


SICK = """
import time
from dataclasses import dataclass
from pathlib import Path
from deltaswarm_agent.body import Sensed
from deltaswarm_wire.checked import key

@dataclass(frozen=True)
class Options:
    charger: str = key("", "a file that is there when it is well")
    stuck: str = key("", "a file that is there while it hangs")

class Sick:
    Settings, REAL_TIME = Options, False
    def __init__(self, options, context):
        self.charger, self.stuck = Path(options.charger), Path(options.stuck)
    def sense(self, time_s):
        while self.stuck.exists():
            time.sleep(0.01)
        return Sensed(5.0, 5.0, 0.1, fault="" if self.charger.exists() else "no battery")
    def move(self, vx_mps, vy_mps, observed):
        pass
    def close(self):
        pass
"""


@pytest.mark.processes
def test_it_says_whose_body_is_not_well_and_when_it_is_well_again(tmp_path: Path) -> None:
    """Also to an operator that came later, and of one that hangs: these are alive and silent, and it is no workload."""
    port = free_port()
    (tmp_path / "sick_body.py").write_text(SICK)
    table = board_table(3, EVENT_AT, {"connect": [endpoint(port)]}, tmp_path)
    table["body"] = {"kind": "sick_body:Sick", "options": {name: str(tmp_path / name) for name in ("charger", "stuck")}}
    with boards(tmp_path) as running:
        running.start(table, *FAST, environment={"PYTHONPATH": str(tmp_path)})
        wait_until(lambda: "not well: no battery" in running.said(3), "a fault")
        with operating(tmp_path, "--listen", endpoint(port)) as operator:
            operator.wait_for("agent 3 is not well: no battery")
            operator.wait_for("1 agents alive (3), not well (3: no battery), ")
            (tmp_path / "charger").touch()
            operator.wait_for("agent 3 is well")
            (tmp_path / "stuck").touch()
            operator.wait_for("agent 3 is not well: it has not stepped for ")
            (tmp_path / "stuck").unlink()
            wait_until(lambda: operator.said.count("agent 3 is well") == 2, "steps")
            wait_until(lambda: "1 agents alive (3), 0.0 " in operator.said.splitlines()[-1], "a line without it")
            rows, totals = operator.end()
    assert {row["agents_ill"] for row in rows} == {"0", "1"}
    assert (totals["messages"], totals["rejected"], totals["agents"]["3"]["fault"]) == (0, 0, "")


@pytest.mark.processes
def test_a_password_is_asked_for_where_there_are_credentials(tmp_path: Path) -> None:
    port = free_port()
    everyone, wrong = tmp_path / "everyone", tmp_path / "wrong"
    everyone.write_text("operator:o\nagent-0:a\nagent-1:b\n")
    wrong.write_text("operator:o\nagent-1:c\n")
    for file in (everyone, wrong):
        file.chmod(0o600)
    arguments = ("--mode", "router", "--listen", endpoint(port), "--credentials", str(everyone))
    with operating(tmp_path, *arguments) as operator, boards(tmp_path) as running:
        for agent, file in ((1, wrong), (0, everyone)):
            air = {"mode": "client", "connect": [endpoint(port)], "credentials_file": str(file)}
            running.start(board_table(agent, EVENT_AT, air, tmp_path), *FAST)
        operator.wait_for("1 agents alive (0), ")
        wait_until(lambda: "first step" in running.said(1), "the other board runs")
        _, totals = operator.end()
    assert set(totals["agents"]) == {"0"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--no-world needs --listen or --connect"),
        (["--listen", "tls/127.0.0.1:7447"], "needs ca, certificate and key"),
        (["--listen", "tcp/127.0.0.1:7447", "--step-s", "0"], "step_s"),
        (["--listen", "tcp/127.0.0.1:7447", "--credentials", "/dev/null"], "0600"),
        (["--listen", "tcp/127.0.0.1:7447", "--credentials", "/nowhere"], "/nowhere"),
    ],
)
def test_it_refuses(arguments: Sequence[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--no-world", "--run", RUN, "--out", str(tmp_path / "out"), *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.processes
def test_a_full_disk_ends_the_table_and_not_the_operator(tmp_path: Path) -> None:
    """It goes on to tell who is alive, and its exit code says at last that the table is not whole."""
    with operating(tmp_path, "--listen", endpoint(free_port()), "--step-s", "0.01") as operator:
        operator.wait_for("nobody")
        resource.prlimit(operator.process.pid, resource.RLIMIT_FSIZE, (len(operator.said) + 2000,) * 2)
        operator.wait_for(f"writing to {tmp_path}")
        lines = operator.said.count("nobody")
        wait_until(lambda: operator.said.count("nobody") > lines, "who is alive")
        operator.process.terminate()
        assert operator.process.wait(PATIENCE_S) == 1
    assert operator.said.count("writing to ") == 1
    assert "incomplete" in operator.said
    assert "Traceback" not in operator.said


def test_another_ones_certificate_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Boards that know who may be there would send it nothing, and say nothing of it."""
    certificates.make(tmp_path, [1], [], 1)
    files = [*tls_arguments(tmp_path, "operator")[:-1], str(tmp_path / "world.key")]
    for given, word in ((tls_arguments(tmp_path, "agent-1"), "agent-1"), (files, "its key")):
        command = ["--no-world", "--run", RUN, "--out", str(tmp_path / "out"), "--listen", "tls/127.0.0.1:0", *given]
        assert main(command) == 2
        assert word in capsys.readouterr().err


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "operator.csv").touch()
    assert main(["--no-world", "--run", RUN, "--out", str(tmp_path), "--listen", "tcp/127.0.0.1:0"]) == 2
    assert "--out must" in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["operator.csv"]


class Payload(bytes):
    def to_bytes(self) -> bytes:
        return self


def sample(key: str, data: bytes) -> Any:
    return SimpleNamespace(key_expr=f"deltaswarm/{RUN}/agent/{key}/report", payload=Payload(data), attachment=None)


def test_rubbish_fills_neither_memory_nor_log(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """So many reports wait and no more, none is larger than reports are, and each agent's key is named once."""
    config = OpenAirConfig(
        run=RUN,
        link=RouterLink(""),
        pairs=[],
        settings=OperatorSettings(),
        step_s=1.0,
        out=tmp_path,
        status_every_s=10.0,
    )
    source = OpenAirSource(config)
    inbox = source.arrivals
    operator = OperatorProcess(source, MagicMock(), MagicMock())
    inbox.put(ArrivalKind.REPORT, sample("7", bytes(MAX_SAMPLE_BYTES + 1)))
    room = MAX_WAITING_BYTES_OF_ONE // (SAMPLE_BYTES + 1)
    for number in range(2 * room + 10):
        inbox.put(ArrivalKind.REPORT, sample(f"x{number}" if number % 2 else "7", b"\xc1"))
    inbox.stop()
    assert operator.run() is End.STOPPED
    assert source.totals["refused_on"] == {"agent 7's key": 6, "no agent's key": 5}
    assert source.meter.totals["rejected"] == 2 * room
    assert len(caplog.records) == 4


def test_one_that_floods_leaves_room_for_the_others() -> None:
    """Of its own samples few wait, however large they are; what was taken makes room again. Tokens are never lost."""
    inbox = BoundedArrivals()
    large = bytes(MAX_SAMPLE_BYTES)
    for _ in range(2 * MAX_WAITING_BYTES_OF_ONE // MAX_SAMPLE_BYTES):
        inbox.put(ArrivalKind.REPORT, sample("7", large))
    waiting = len(inbox)
    assert waiting <= MAX_WAITING_BYTES_OF_ONE // MAX_SAMPLE_BYTES
    inbox.put(ArrivalKind.REPORT, sample("8", large))
    assert len(inbox) == waiting + 1
    inbox.get(0.0)
    inbox.put(ArrivalKind.REPORT, sample("7", large))
    assert len(inbox) == waiting + 1
    assert set(inbox.refused) == {7}
    for number in range(2 * MAX_TOKENS):
        inbox.put(ArrivalKind.TOKEN, sample(str(number % 3), b""))
    inbox.put(ArrivalKind.TOKEN, last := sample("1", b""))
    assert len(inbox) == MAX_TOKENS
    taken = [inbox.get(0.0) for _ in range(MAX_TOKENS + 3)]
    assert (ArrivalKind.TOKEN, last) in taken
    with pytest.raises(queue.Empty):
        inbox.get(0.0)
