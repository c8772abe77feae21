"""What real processes leave on their machine, and what they say of one on which they cannot run."""

import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest
import tomli_w

from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_wire import checked
from deltaswarm_wire.child import WORLD_LOST
from tests.support.swarms import PATIENCE_S, running, told
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

OWN_MOUNTS, OWN_NETWORK = ("unshare", "-rm"), ("unshare", "-rn")
OWN_SHARED_MEMORY = (*OWN_MOUNTS, "sh", "-c", "mount -t tmpfs none /dev/shm && echo mounted && exec cat")

NO_RETRY = "--zenoh listen/exit_on_failure=true --zenoh listen/timeout_ms=0"
ELSEWHERE = "tcp/192.0.2.1:7447"
"""No machine's address: it is kept for documentation."""


@cache
def is_allowed(*command: str) -> bool:
    """Whether a command works here: in many containers nobody may make namespaces."""
    return shutil.which(command[0]) is not None and subprocess.run(command, input=b"", check=False).returncode == 0


@contextmanager
def own_shared_memory() -> Iterator[tuple[tuple[str, ...], Path]]:
    """A /dev/shm that nobody else on the machine uses: the command that runs another one there, and the folder."""
    with subprocess.Popen(OWN_SHARED_MEMORY, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"mounted\n"
        inside = ("nsenter", f"--target={holder.pid}", "--user", "--mount", "--preserve-credentials", "--wdns=.")
        yield inside, Path(f"/proc/{holder.pid}/root/dev/shm")


@pytest.mark.skipif(not is_allowed(*OWN_SHARED_MEMORY), reason="no mounts of one's own here")
@pytest.mark.parametrize("is_interrupted", first_of([True, False]), ids=["Ctrl-C", "whole"])
def test_a_run_leaves_no_shared_memory(tmp_path: Path, is_interrupted: bool) -> None:
    """Not a byte in /dev/shm."""
    duration_s = 1e6 if is_interrupted else 10
    arguments = ("--set", f"run.duration_s={duration_s}", "--record", "off")
    with own_shared_memory() as (inside, shared), running(tmp_path / "run", *arguments, inside=inside) as swarm:
        if is_interrupted:
            swarm.wait_for_steps(5)
            swarm.interrupt(signal.SIGINT)
        code, _, errors = swarm.finish()
        assert code == (130 if is_interrupted else 0), errors
        assert list(shared.iterdir()) == []


@pytest.mark.skipif(not is_allowed(*OWN_NETWORK, "true"), reason="no network of one's own here")
def test_without_loopback_one_line_says_what_to_do(tmp_path: Path) -> None:
    """The doctor finds it too, and nothing was begun."""
    done = told("run", "smoke", "--out", str(tmp_path / "run"), inside=OWN_NETWORK)
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout, list(tmp_path.iterdir())) == (1, "", [])
    assert line.startswith("deltaswarm: ")
    assert "127.0.0.1" in line
    assert "run `deltaswarm doctor`" in line
    doctor = told("doctor", inside=OWN_NETWORK)
    assert doctor.returncode == 1
    assert [line.split()[1] for line in doctor.stdout.splitlines() if line.startswith("MISSING")] == ["loopback"]


@pytest.mark.parametrize(
    "part",
    [
        "agent --id 0 --settings agent.toml --run r --connect tcp/127.0.0.1:9",
        "operator --out . --run r --connect tcp/127.0.0.1:9",
        f"operator --no-world --out . --run r {NO_RETRY} --listen {ELSEWHERE}",
        f"world --scenario scenario.toml --run r --credentials c --out . --listen {ELSEWHERE}",
    ],
    ids=lambda part: " ".join(part.split()[:2]),
)
def test_a_part_that_gets_no_session_says_so_in_one_line(tmp_path: Path, part: str) -> None:
    """With what it tried, and without a place in Zenoh's sources."""
    scenario = load_scenario("smoke")
    (tmp_path / "scenario.toml").write_text(to_toml(scenario))
    (tmp_path / "agent.toml").write_text(tomli_w.dumps(checked.plain(scenario.for_agent(0))))
    environment = {**os.environ, "DELTASWARM_PASSWORD": "x"}
    done = told(*part.split(), cwd=tmp_path, env=environment, timeout=PATIENCE_S)
    assert done.returncode == (WORLD_LOST if "--connect" in part else 1)
    (line,) = done.stderr.splitlines()
    assert part.split()[-1] in line
    assert ".rs" not in line
