"""The host of a run's agents on one worker: a Dask actor that starts `python -m deltaswarm_cluster.host JOB`.

The program reads its job from the file descriptor JOB, starts the agents from a fork server, and prints a JSON list for
everything that happens to them. When its standard input ends, because the actor was released or its worker died, it
ends the agents and removes their files. If the program is killed, the agents remove their keys as they end.
"""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any

from deltaswarm_orchestrator.base import limits
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.temporary import TemporaryFolder, remove_left
from deltaswarm_orchestrator.processes.entry_point import SECRETS_VARIABLE
from deltaswarm_orchestrator.processes.process import wait_for
from deltaswarm_orchestrator.processes.starter import LaunchError, Starter
from deltaswarm_wire.files import write_secret
from deltaswarm_wire.keys import AGENT

UP, LOG, ENDED, FAILED, OVER = "up", "log", "ended", "failed", "over"
"""The first items of what a host prints, followed by: nothing; an agent and new text of its log; an agent, its exit
code and `RunPart.outlasted`; the reason; nothing."""

News = list[list[Any]]
STOP = b"stop\n"

ENDINGS = {"settings": "toml", "certificate": "pem", "key": "key"}
"""The endings of an agent's files, by the option that takes them."""

MAX_LOG_BYTES = 1 << 20
"""Maximum number of bytes of an agent's log in one item."""

POLL_S = 0.1
LEAVE_WITHIN_S = 2.0
"""Time for agents to end by themselves when the run is over [s]: the world's last words are on their way to them."""

END_WITHIN_S = 12.0
"""Time that a host may take to end its agents [s]."""


@dataclass(frozen=True)
class Job:
    """What the host on one worker is to do. Dask logs the arguments of tasks that fail, so secrets are not shown."""

    mode: str
    """The scenario's controller, which is loaded once for all agents if it is shipped."""
    start_timeout_s: float
    options: dict[str, Any]
    """Options of all agents' command lines."""
    ca: str = field(repr=False)
    """Certificate of the run's authority (PEM)."""
    agents: Sequence[tuple[int, str, str, str]] = field(repr=False)
    """Number, settings (TOML), certificate and private key (PEM) of each agent."""


class HostActor:
    """The host of one job. Releasing the object ends the agents, as do the loss of client, scheduler and worker."""

    def __init__(self, job: Job) -> None:
        with open(os.memfd_create("job"), "w+b") as file:  # in memory, since it has private keys
            file.write(json.dumps(asdict(job)).encode())
            file.seek(0)
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "deltaswarm_cluster.host", str(file.fileno())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                pass_fds=(file.fileno(),),
                start_new_session=True,  # a Ctrl-C in the worker's terminal is for the worker
            )
        self._stdin, self._stdout = _pipes(self._process)
        self.close = weakref.finalize(self, _release, self._process)
        self.close.atexit = False  # this process's end closes the pipes, and no thread can be started by then
        os.set_blocking(self._stdout.fileno(), False)
        self._unread = b""

    @property
    def pid(self) -> int:
        return self._process.pid

    def poll(self) -> News:
        is_dead = self._process.poll() is not None
        *lines, self._unread = (self._unread + (self._stdout.read() or b"")).split(b"\n")
        news = [json.loads(line) for line in lines]
        if is_dead:
            self.close()
            news.append([FAILED, f"its process ended with code {self._process.returncode}"])
        return news

    def stop(self) -> None:
        """Ask the agents to end; `poll` tells when they have."""
        with suppress(OSError):
            self._stdin.write(STOP)


def _pipes(process: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes]]:
    assert process.stdin is not None
    assert process.stdout is not None
    return process.stdin, process.stdout


def _release(process: subprocess.Popen[bytes]) -> None:
    """Let a host end, without waiting for it here, and remove what a killed host leaves."""
    for pipe in _pipes(process):  # a host that waits for a reader then ends, too
        pipe.close()
    threading.Thread(target=_wait_and_remove, args=(process,), daemon=True).start()


def _wait_and_remove(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(END_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()  # its agents end with it
        process.wait()
    remove_left(Path(tempfile.gettempdir()))


class Host:
    """The agents of a job, whose files are in a private folder."""

    def __init__(self, job: Job, folder: Path) -> None:
        self._job, self._folder = job, folder
        (folder / "logs").mkdir()
        self._starter = Starter(folder / "logs", job.mode, job.start_timeout_s, lambda: False)
        self._told: set[int] = set()
        """Agents whose end is told."""
        self._read_bytes = dict.fromkeys([agent for agent, *_ in job.agents], 0)
        """How much of each agent's log is told."""
        self._is_orphan = False
        """Whether the actor has closed its end of standard input."""

    def serve(self) -> None:
        """Start the agents; end them once asked to, and stay until the actor has gone."""
        try:
            try:
                self._start()
            except (CommandError, LaunchError) as error:
                _say(FAILED, str(error))
            while not self._is_asked(POLL_S):
                self._tell()
            if not self._is_orphan:
                wait_for(self._starter.parts, LEAVE_WITHIN_S)
        finally:
            self._starter.end(at_once=self._is_orphan)
        self._tell()
        _say(OVER)
        while not self._is_orphan:
            self._is_asked(None)

    def _start(self) -> None:
        limits.make_room(len(self._job.agents))
        (ca := self._folder / "ca.pem").write_text(self._job.ca)
        for agent, *contents in self._job.agents:
            options = {"--id": agent, "--ca": ca, **self._job.options}
            for (kind, ending), content in zip(ENDINGS.items(), contents, strict=True):
                options[f"--{kind}"] = file = self._folder / f"{agent}.{ending}"
                write_secret(file, content.encode())
            self._starter.start(AGENT, agent, options)

    def _is_asked(self, within_s: float | None) -> bool:
        """Wait for a request to end; return whether there is one, by words or because the actor has gone."""
        if not select.select([0], [], [], within_s)[0]:
            return False
        self._is_orphan = not os.read(0, 1024)
        return True

    def _tell(self) -> None:
        ended = [part for part in self._starter.parts if part.number not in self._told and part.exit_code is not None]
        for agent, begin in self._read_bytes.items():  # before the ends, whose last lines are then told
            with suppress(OSError), (self._folder / "logs" / f"{AGENT}-{agent}.log").open("rb") as file:
                file.seek(begin)
                if new := file.read(MAX_LOG_BYTES):
                    self._read_bytes[agent] += len(new)
                    _say(LOG, agent, new.decode(errors="surrogateescape"))
        for part in ended:
            self._told.add(part.number)
            _say(ENDED, part.number, part.exit_code, part.outlasted)


def _say(*items: object) -> None:
    with suppress(OSError):  # the actor has gone
        os.write(1, json.dumps(items).encode() + b"\n")  # unbuffered: nothing is left to write at the end


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with open(int(sys.argv[1]), "rb") as file:
        job = Job(**json.load(file))
    _say(UP)
    with TemporaryFolder() as folder:
        os.environ[SECRETS_VARIABLE] = str(folder)
        Host(job, folder).serve()


if __name__ == "__main__":
    main()
