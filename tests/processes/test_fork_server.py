"""A fork server that is killed or stopped: what it has started goes on, and ends as it should."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from tests.processes.test_endings import STEADY, ends_by_itself, pid_of
from tests.support.swarms import COMMAND, UNHURRIED, heeds, is_running, parent_of, running, wait_until
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes


@pytest.mark.parametrize("number", first_of([signal.SIGKILL, signal.SIGSTOP]))
def test_a_fork_server_that_is_gone_keeps_nobody(number: signal.Signals, tmp_path: Path) -> None:
    """Killed or stopped in mid-run: Ctrl-C still ends all that it started, and it."""
    with running(tmp_path / "run", *STEADY) as swarm:
        pids = swarm.wait_until_under_way()
        fork_server = parent_of(pids["world"])
        os.kill(fork_server, number)
        swarm.wait_for_steps(1)
        swarm.interrupt()
        code, _ = ends_by_itself(swarm)
    assert code == 130
    assert swarm.manifest()["exit_reason"] == "stopped by SIGINT"
    wait_until(lambda: not any(map(is_running, (*pids.values(), fork_server))), "the end of all")


def fork_servers_of(pid: int) -> Iterator[int]:
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (
                parent_of(int(folder.name)) == pid
                and b"multiprocessing.forkserver" in (folder / "cmdline").read_bytes()
            ):
                yield int(folder.name)


def test_a_fork_server_killed_before_it_has_started_anything_is_replaced(tmp_path: Path) -> None:
    """While it imports what all parts share."""
    with running(tmp_path / "run", "--set", "run.duration_s=50") as swarm:
        server = wait_until(lambda: next(fork_servers_of(swarm.process.pid), None), "the fork server")
        os.kill(server, signal.SIGKILL)
        swarm.end_well()
    assert swarm.summary()["valid"]


def test_a_terminals_ctrl_c_spares_a_fork_server_that_starts(tmp_path: Path) -> None:
    """It reaches that process, too, which would print a traceback and make the run fail for another reason."""
    with running(tmp_path / "run", *STEADY) as swarm:
        wait_until(lambda: any(map(heeds, fork_servers_of(swarm.process.pid))), "the fork server's Python")
        swarm.interrupt()
        code, errors = ends_by_itself(swarm)
    assert code == 130
    assert len(errors.splitlines()) == 1, errors
    assert "stopped by SIGINT" in errors


@pytest.mark.parametrize("number", first_of([signal.SIGKILL, signal.SIGSTOP]))
def test_a_fork_server_lost_as_it_starts_is_replaced(number: signal.Signals, tmp_path: Path) -> None:
    """Or continued; those who are still to be started come in time, and the run goes on as if nothing had been."""
    with running(tmp_path / "run", "--set", "run.duration_s=50") as swarm:
        world = wait_until(lambda: pid_of(swarm, "world-0.log"), "the world")
        os.kill(parent_of(world), number)
        swarm.end_well()
    assert swarm.summary()["valid"]


@pytest.mark.parametrize("number", first_of([signal.SIGKILL, signal.SIGSTOP]))
def test_without_its_fork_server_a_run_goes_on_and_knows_how_its_parts_end(
    number: signal.Signals, tmp_path: Path
) -> None:
    """An agent that is killed later is called killed; the others, the operator too, end in order with the world."""
    with running(tmp_path / "run", "--set", "run.duration_s=300", *UNHURRIED) as swarm:
        pids = swarm.wait_until_under_way()
        os.kill(parent_of(pids["world"]), number)
        swarm.signal("agent 3", signal.SIGKILL)
        swarm.end_without(3)
    [why] = swarm.manifest()["why"]
    assert why.startswith("agent 3 was killed by SIGKILL in step ")
    assert swarm.summary()["agents_lost"] == [3]


def test_a_long_path_for_temporary_files_is_no_obstacle(tmp_path: Path) -> None:
    """As batch systems set it: the path of the fork server's socket has at most 107 bytes."""
    temporary = tmp_path / ("t" * 100)
    temporary.mkdir()
    command = [*COMMAND, "run", "smoke", "--set", "run.duration_s=5", "--record", "off", "--out", str(tmp_path / "run")]
    done = subprocess.run(
        command, env={**os.environ, "TMPDIR": str(temporary)}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert not list(temporary.iterdir())


CLEARED = """
import multiprocessing, shutil, sys
import deltaswarm
for number in range(2):
    run = deltaswarm.run("smoke", {"run.duration_s": 20.0}, engine="processes", out=f"{sys.argv[1]}/{number}")
    shutil.rmtree(multiprocessing.current_process()._config["tempdir"])
    print(run.summary["valid"])
"""


def test_a_folder_of_sockets_that_was_cleared_is_made_anew(tmp_path: Path) -> None:
    """As where old files below /tmp are removed while somebody works in a notebook."""
    command = [sys.executable, "-c", CLEARED, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["True", "True"]), done.stderr
