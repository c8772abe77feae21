"""Real runs that are looked at: by Foxglove, on a terminal, and by viewers that hang; none of them leaves a trace."""

import json
import socket
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from deltaswarm_orchestrator.live.views import LIVE_SOCKET, connected
from deltaswarm_orchestrator.recording.scene import EPOCH_S
from deltaswarm_orchestrator.recording.schemas import TOPICS
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from tests.support.foxglove import CHANNELS, stuck_at, url_of, viewing
from tests.support.swarms import UNHURRIED, running, told, wait_until

pytestmark = pytest.mark.processes

DURATION_S = 300
WATCHED = ("--set", f"run.duration_s={DURATION_S}", *UNHURRIED)
LIVE = ("--live", "foxglove", "--live-port", "0")


@cache
def digest(duration_s: int) -> str:
    """Of the same run when nobody looks on."""
    return run_in_process(load_scenario("smoke", [f"run.duration_s={duration_s}"])).digest


def test_a_run_is_seen_while_it_is_under_way(tmp_path: Path) -> None:
    """Without a recording, too: every topic with its schema, simulated times, agents; a viewer may leave."""
    with running(tmp_path / "run", *WATCHED, *LIVE, "--record", "off") as swarm:
        url = url_of(swarm)
        assert url.startswith("ws://127.0.0.1:")
        with pytest.raises(InvalidStatus), connect(url):
            pass
        with viewing(url) as viewer:
            assert viewer.server["capabilities"] == ["time"]
            assert set(viewer.channels) == set(CHANNELS)
            assert {channel["topic"] for channel in viewer.channels.values()} == set(TOPICS)
            next(message for topic, _, message in viewer.messages() if topic == "/tf")
            with viewing(url) as late:  # is shown all topics, also those that are told when they change
                seen: dict[str, int] = {}
                for topic, time_ns, message in late.messages():
                    seen[topic] = time_ns
                    if topic == "/tf":
                        assert len(message.transforms) == 1 + 6
                    if seen.keys() >= TOPICS.keys() - {"/log", "/swarm/event"}:
                        break
        assert all(EPOCH_S <= time_ns / 1e9 <= EPOCH_S + DURATION_S for time_ns in seen.values())
        errors = swarm.end_well()
        assert "foxglove.sdk.v1" in errors, "who was refused is told why"
        assert swarm.summary()["digest"] == digest(DURATION_S)
        assert not (swarm.out / "recording.mcap").exists()
        assert (swarm.out / "layout.json").exists()


def test_viewers_that_hang_do_not_slow_the_run(tmp_path: Path) -> None:
    """They subscribe, or connect, and never read: the run ends with the same digest, and is recorded whole."""
    with running(tmp_path / "run", *WATCHED, *LIVE) as swarm:
        url = url_of(swarm)
        wait_until(lambda: (swarm.part / LIVE_SOCKET).exists(), "a socket")
        # Plain sockets: a WebSocket library would read on in a thread of its own.
        with stuck_at(url), stuck_at(url), connected(swarm.part, 10.0), connected(swarm.part, 10.0):
            swarm.end_well()
        assert swarm.summary()["digest"] == digest(DURATION_S)
        assert swarm.summary()["valid"]
        assert (swarm.out / "recording.mcap").exists()


@pytest.mark.parametrize(
    ("duration_s", "options"),
    [(DURATION_S, UNHURRIED), pytest.param(60, ("--in-process", *UNHURRIED), marks=pytest.mark.slow)],
    ids=["processes", "in-process"],
)
def test_top_attaches_to_a_run_and_leaves_it(tmp_path: Path, duration_s: int, options: Sequence[str]) -> None:
    """It finds the run, shows the truth and what the operator counted; the folder is as if nobody had come."""
    with running(tmp_path / "runs" / "first", "--set", f"run.duration_s={duration_s}", *options) as swarm:
        wait_until(lambda: (swarm.part / LIVE_SOCKET).exists(), "a socket")
        found = told("top", "--json", cwd=tmp_path)
        assert found.returncode == 0, found.stderr
        said = json.loads(found.stdout)
        assert (said["hello"]["run"], said["hello"]["kind"]) == ("first", "researcher")
        assert said["picture"]["type"] == "picture"
        swarm.end_well()
        assert swarm.summary()["digest"] == digest(duration_s)
        assert not (swarm.out / LIVE_SOCKET).exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--live", "foxglove", "--live-port", "{taken}"], ["--live-port must", "{taken}"]),
        (["--live-port", "0"], ["--live"]),
        (["--live-port", "65536"], ["--live"]),
    ],
)
def test_what_cannot_be_shown_is_refused_before_anything_begins(
    arguments: list[str], said: list[str], tmp_path: Path
) -> None:
    """A port that is taken, has no viewer, or is none; no folder is made."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        done = told("run", "smoke", "--out", "run", *(word.format(taken=port) for word in arguments), cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert all(words.format(taken=port) in done.stderr for words in said)
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_it_says_what_to_install(tmp_path: Path) -> None:
    """And makes no folder."""
    hidden = "import sys; sys.modules['foxglove'] = None; from deltaswarm_cli.main import main; "
    program = f"{hidden}sys.exit(main(['run', 'smoke', '--out', 'run', '--live', 'foxglove']))"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "pip install 'deltaswarm[live]'" in done.stderr
    assert list(tmp_path.iterdir()) == []
