"""Markers for other instruments: what comes over the socket and over LSL, and when."""

import json
import socket
import time
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.console_server import Channel, ConsoleServer, Outlet
from deltaswarm_operator.io.markers import LSL, STREAM, SocketMarkers, markers_to
from deltaswarm_orchestrator.processes.station import free_address
from deltaswarm_wire.operator_messages import Clock, Workload
from tests.support.commanding import briefing

PATIENCE_S = 30.0


def listening() -> tuple[SocketMarkers, str]:
    address = free_address("127.0.0.1:0")
    return SocketMarkers(address, "a-run"), address


def client_of(address: str) -> Any:
    host, _, port = address.rpartition(":")
    return socket.create_connection((host, int(port)), PATIENCE_S).makefile("rb")


def test_acts_and_questions_are_told_as_they_happen(tmp_path: Path) -> None:
    """In order, each with its own time by both clocks; whoever connects learns of the run first."""
    markers, address = listening()
    end, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    console = Console(briefing(operator={"probes": {"isa_every_s": 1.0, "tlx": True}}))
    ignore: list[Any] = []
    outlet, station = Outlet(ignore.append, ignore.append), Channel(end, ignore.append)
    server = ConsoleServer("a-run", console, tmp_path, outlet, station, markers=markers)
    lines = client_of(address)
    server.start()

    def close(step: int, last: bool = False) -> None:
        workload = Workload(step, float(step), 0, 0, 0.0, 0.0, 0.0, 0, 0, 0)
        server.close_step(Clock(step, float(step), last), workload, ())

    def say(**intent: Any) -> float:
        before = time.monotonic()
        server.on_intent(json.dumps({"from": 3, **intent}).encode())
        return before

    with end, other:
        close(0)
        close(1)
        answered = say(type="isa", number=0, answer=4)
        ordered = say(type="command", name="go", target={"kind": "tree", "root": 4})
        close(2, last=True)
        server.finish()
    told = [json.loads(line) for line in lines]
    kinds = [(marker["kind"], marker.get("probe") or marker.get("name")) for marker in told]
    assert kinds[:6] == [
        ("hello", None),
        ("begin", None),
        ("question", "isa"),
        ("isa", None),
        ("answer", "isa"),
        ("command", "go"),
    ]
    assert kinds[6] == ("end", None)
    assert set(kinds[7:]) == {("question", "tlx"), ("missing", "tlx")}
    assert (told[0]["run"], told[3]["value"], told[4]["value"], told[5]["agent"]) == ("a-run", 4, 4, 4)
    assert answered <= told[3]["monotonic_s"] <= ordered <= told[5]["monotonic_s"] <= ordered + PATIENCE_S
    assert all(marker["utc"].endswith("Z") for marker in told)


def test_one_who_does_not_read_is_dropped_and_nobody_waits() -> None:
    markers, address = listening()
    idle, reader = client_of(address), client_of(address)
    markers.serve()
    assert json.loads(reader.readline())["kind"] == "hello"
    began = time.monotonic()
    for number in range(1000):
        markers.put(None, {"kind": "note", "name": str(number), "text": "x" * 20_000})
        assert json.loads(reader.readline())["name"] == str(number)
    assert time.monotonic() - began < PATIENCE_S
    assert idle.read(), "what fitted into its buffers, and then the end"
    markers.close()


def test_an_inlet_of_lsl_gets_them_with_their_times() -> None:
    """The time stamp is that of the act, not of the sending."""
    pylsl = pytest.importorskip("pylsl", exc_type=(ImportError, RuntimeError))
    markers = markers_to(LSL, "a-run")
    [found] = pylsl.resolve_byprop("name", STREAM, 1, PATIENCE_S)
    inlet = pylsl.StreamInlet(found)
    inlet.open_stream(PATIENCE_S)
    markers.put(time.monotonic() - 2.0, {"kind": "isa", "value": 3, "text": ""})
    sample, stamp_s = inlet.pull_sample(PATIENCE_S)
    marker = json.loads(sample[0])
    assert (marker["kind"], marker["value"], "text" in marker) == ("isa", 3, False)
    assert pylsl.local_clock() - stamp_s == pytest.approx(2.0, abs=1.5)
    markers.close()
