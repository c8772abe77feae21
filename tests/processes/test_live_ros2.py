"""Runs that are shown to ROS 2's tools, of which a plain Zenoh session with rosbags' codec stands in for one."""

import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.support.fields import endpoint, free_port
from tests.support.ros2_robots import session
from tests.support.ros2_types import STORE, bag_decoded
from tests.support.swarms import UNHURRIED, running, told, wait_until

pytestmark = pytest.mark.processes

KEYS = {
    "visualization_msgs/msg/MarkerArray": "0/deltaswarm/markers/visualization_msgs::msg::dds_::MarkerArray_",
    "diagnostic_msgs/msg/DiagnosticArray": "0/diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_",
}


def test_a_run_is_seen_in_ros(tmp_path: Path) -> None:
    """In processes: markers with all agents and diagnostics that go on, by a node with tokens; the run is valid."""
    router = free_port()
    found: dict[str, list[dict[str, Any]]] = {kind: [] for kind in KEYS}
    numbers: dict[bytes, list[int]] = {}

    def take(kind: str, sample: zenoh.Sample) -> None:
        assert sample.attachment is not None
        number, _, length, gid = struct.unpack("<qqb16s", sample.attachment.to_bytes())
        assert length == 16
        numbers.setdefault(gid, []).append(number)
        found[kind].append(bag_decoded(kind, sample.payload.to_bytes()))

    with session("router", endpoint(router)) as ros:
        subscribers = [
            ros.declare_subscriber(f"{key}/{STORE.hash_rihs01(kind)}", lambda sample, kind=kind: take(kind, sample))
            for kind, key in KEYS.items()
        ]
        live = ("--live", "ros2", "--live-connect", endpoint(router))
        with running(tmp_path / "run", "--set", "run.duration_s=300", *UNHURRIED, *live) as swarm:
            wait_until(lambda: all(len(messages) > 2 for messages in found.values()), "messages")
            tokens = [str(reply.ok.key_expr) for reply in ros.liveliness().get("@ros2_lv/0/**") if reply.ok]
            assert sorted(token.split("/")[5] for token in tokens) == ["MP", "MP", "NN"]
            swarm.end_well()
        assert len(subscribers) == len(KEYS)
    agents = found["visualization_msgs/msg/MarkerArray"][-1]["markers"][0]
    assert (agents["ns"], len(agents["points"])) == ("agents", 6)
    names = {status["name"] for message in found["diagnostic_msgs/msg/DiagnosticArray"] for status in message["status"]}
    assert names == {"deltaswarm: swarm", "deltaswarm: operator's workload"}
    assert len(numbers) == len(KEYS)
    assert all(counted == sorted(set(counted)) for counted in numbers.values())
    assert swarm.summary()["valid"]


def test_without_a_router_or_a_recording_it_says_what_is_needed(tmp_path: Path) -> None:
    """And makes no folder."""
    where = ("--live-connect", f"tcp/127.0.0.1:{free_port()}")
    for arguments, words in (
        (where, "--live ros2 needs a Zenoh router at tcp/127.0.0.1:"),
        (("--record", "off"), "--live ros2 must be given without --record off"),
        (("--live-port", "0"), "--live-port must be given with --live foxglove"),
    ):
        done = told("run", "smoke", "--out", "run", "--live", "ros2", *arguments, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert words in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_not_shown_there_imports_nothing_of_ros() -> None:
    """Neither the command line nor a run's lifecycle."""
    program = "import sys, deltaswarm_cli.main, deltaswarm_orchestrator.run.lifecycle; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not [name for name in done.stdout.split() if "ros2" in name]
