"""A board ends when it is told to, whatever its body does, and does not end because a disk is full."""

import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from tests.support.fields import EVENT_AT, Boards, board_table, boards, endpoint, free_port
from tests.support.swarms import PATIENCE_S, wait_until
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

BODIES = """
import signal, sys, threading, time
from dataclasses import dataclass
from deltaswarm_agent.body import Sensed

@dataclass(frozen=True)
class Nothing:
    pass

class Well:
    Settings, REAL_TIME = Nothing, True
    def __init__(self, options, context):
        print("made", file=sys.stderr, flush=True)
    def sense(self, time_s):
        return Sensed(5.0, 5.0, 0.1)
    def move(self, vx_mps, vy_mps, observed):
        pass
    def close(self):
        print("stands", file=sys.stderr, flush=True)

def hang():
    print("hangs", file=sys.stderr, flush=True)
    time.sleep(1000)

class HangsAsItIsMade(Well):
    def __init__(self, options, context):
        hang()

class HangsAsItSenses(Well):
    def sense(self, time_s):
        hang()

class HangsWhereNoSignalComes(Well):
    def sense(self, time_s):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})  # it wakes another thread, and this one sleeps on
        hang()

class HangsAsItCloses(Well):
    def close(self):
        hang()

class HangsAfterwards(Well):
    def close(self):
        threading.Thread(target=hang).start()

class Ill(Well):
    def sense(self, time_s):
        return Sensed(5.0, 5.0, 0.1, fault="no battery")

class FailsToClose(Well):
    def close(self):
        raise OSError("no way to reach it")
"""


def start(
    running: Boards,
    kinds: Sequence[str],
    *arguments: str,
    first: int = 0,
    environment: Mapping[str, str] | None = None,
    **tables: Any,
) -> None:
    (running.folder / "bodies_of_a_test.py").write_text(BODIES)
    for agent, kind in enumerate(kinds, first):
        table = board_table(agent, EVENT_AT, {"listen": [endpoint(free_port())]}, running.folder)
        body = {"kind": f"bodies_of_a_test:{kind}"}
        path = {"PYTHONPATH": str(running.folder)}
        running.start({**table, "body": body, **tables}, *arguments, environment={**path, **(environment or {})})


def test_a_body_that_hangs_does_not_keep_the_process(tmp_path: Path) -> None:
    """In whatever it hangs: it is left behind, with word of where, and exit code 1."""
    kinds = ("HangsAsItIsMade", "HangsAsItSenses", "HangsWhereNoSignalComes", "HangsAsItCloses", "HangsAfterwards")
    where = ("__init__", "sense", "sense", "close", "hang")
    begun = ("hangs", "hangs", "hangs", "first step", "first step")
    with boards(tmp_path) as running:
        start(running, kinds)
        for agent, text in enumerate(begun):
            wait_until(lambda agent=agent, text=text: text in running.said(agent), f"{kinds[agent]}: {text}")
        for process in running.processes.values():
            process.terminate()
        for agent, process in running.processes.items():
            assert process.wait(PATIENCE_S) == 1
            assert f"in {where[agent]}" in running.said(agent)


def test_systemd_hears_no_more_of_a_body_that_hangs(tmp_path: Path) -> None:
    """So its watchdog acts; one that is ill steps on, and its status says what is wrong."""
    with boards(tmp_path) as running, ExitStack() as sockets:
        told = []
        for agent, kind in enumerate(("HangsAsItSenses", "Ill")):
            (tmp_path / kind).mkdir()
            systemd = sockets.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            systemd.bind(str(tmp_path / kind / "notify"))
            told.append(systemd)
            notify = {"NOTIFY_SOCKET": str(tmp_path / kind / "notify"), "WATCHDOG_USEC": "200000"}
            start(running, [kind], first=agent, environment=notify, log={"every_s": 1.0})
        wait_until(lambda: "hangs" in running.said(0), "a body that hangs")
        told[0].setblocking(False)
        told[1].settimeout(PATIENCE_S)
        while b"not well: no battery" not in told[1].recv(1000):  # of a second, in which systemd hears of the other
            pass
        heard = []
        with suppress(BlockingIOError):
            while True:
                heard.append(told[0].recv(1000))
        assert len(heard) <= 1, heard


@pytest.mark.parametrize("number", first_of([signal.SIGTERM, signal.SIGINT, signal.SIGHUP]))
def test_a_signal_has_the_robot_stand(number: signal.Signals, tmp_path: Path) -> None:
    with boards(tmp_path) as running:
        start(running, ["Well"])
        wait_until(lambda: "made" in running.said(0), "a body")
        running.processes[0].send_signal(number)
        assert running.processes[0].wait(PATIENCE_S) == 0
        assert f"stopped by {number.name}" in running.said(0)
        assert "stands" in running.said(0)


def test_what_is_left_to_do_is_done_where_a_body_fails_to_close(tmp_path: Path) -> None:
    with boards(tmp_path) as running:
        start(running, ["FailsToClose"], "--steps", "1", log={"folder": str(tmp_path / "logs"), "record": "mcap"})
        assert running.processes[0].wait(PATIENCE_S) == 1
    with (tmp_path / "logs" / "agent-0.mcap").open("rb") as stream:
        assert make_reader(stream).get_summary() is not None


def test_a_folder_that_cannot_be_written_to_is_said_and_left(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    log = {"folder": str(tmp_path / "file" / "logs"), "record": "mcap"}
    with boards(tmp_path) as running:
        start(running, ["Well"], "--steps", "2", log=log)
        assert running.processes[0].wait(PATIENCE_S) == 0
        for text in ("cannot log to", "recording is off: ", "first step", "body faulty in 0"):
            assert text in running.said(0)


def test_two_threads_that_find_the_disk_full_say_so_once(tmp_path: Path) -> None:
    """The second one waited while the first gave the file up; its line is not lost."""
    (tmp_path / "agent-0.log").symlink_to("/dev/full")
    program = (
        "import logging, sys\n"
        "from deltaswarm_board.service import log_to\n"
        "from deltaswarm_board.settings import LogSettings\n"
        "from deltaswarm_wire.logs import log_to_standard_error\n"
        "log_to_standard_error()\n"
        "log_to(LogSettings(folder=sys.argv[1]), 0)\n"
        "(files,) = [one for one in logging.getLogger().handlers if hasattr(one, 'baseFilename')]\n"
        "logging.getLogger('one').info('first line')\n"
        "files.handle(logging.makeLogRecord({'levelno': 20, 'levelname': 'INFO', 'msg': 'second line'}))\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True, check=True)
    said = [done.stderr.count(words) for words in ("agent-0.log stopped", "first line", "second line")]
    assert said == [1, 1, 1], done.stderr


def test_a_log_on_a_full_disk_moves_to_standard_error(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "agent-0.log").symlink_to("/dev/full")
    with boards(tmp_path) as running:
        start(running, ["Well"], "--steps", "2", log={"folder": str(tmp_path / "logs")})
        assert running.processes[0].wait(PATIENCE_S) == 0
        said = running.said(0)
    assert said.count("agent-0.log stopped") == 1
    assert "Traceback" not in said
    assert "first step" in said
    assert "body faulty in 0" in said
