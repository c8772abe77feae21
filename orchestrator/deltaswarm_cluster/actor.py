"""The Dask actor on each worker: it starts a supervisor of agents there, and returns what has happened to them.

Whatever ends it (the run, the loss of the client or of the scheduler, the death of the worker) closes the supervisor's
standard input, which ends the agents. Orchestrator and workers run the same version of this file.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import weakref
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from deltaswarm_cluster import supervisor
from deltaswarm_orchestrator.base.temporary import locked_folder, remove_left
from deltaswarm_wire.access import TLS
from deltaswarm_wire.files import write_secret
from deltaswarm_wire.session import protocol_of

END_WITHIN_S = 12.0
"""Time that a supervisor may take to end its agents [s]."""

MAX_LOG_BYTES = 1 << 20
"""Maximum number of bytes of an agent's log in one update."""

STOP = b"stop\n"

PREFIX = "deltaswarm-agents-"
"""What the names of supervisors' folders begin with."""


@dataclass(frozen=True)
class AgentFiles:
    """The files of one agent, in memory."""

    settings: str
    """Its settings (TOML)."""
    certificate: bytes = field(repr=False)
    key: bytes = field(repr=False)
    """Its private key (PEM). It is in no representation, since Dask logs the arguments of tasks that fail."""


@dataclass(frozen=True)
class AgentsJob:
    """What the supervisor on one worker is to do."""

    run: str
    """The run's name on the network."""
    connect: str
    """The world's endpoint."""
    mode: str
    """The scenario's controller, which is loaded once for all agents if it is shipped."""
    start_timeout_s: float
    authority: bytes = field(repr=False)
    """Certificate of the authority (PEM)."""
    agents: dict[int, AgentFiles] = field(repr=False)
    zenoh: tuple[str, ...] = ()
    """The user's own Zenoh settings, as KEY=VALUE."""


@dataclass
class Update:
    """What has happened to a worker's agents since the last update."""

    logs: dict[int, bytes] = field(default_factory=dict)
    """New bytes of the agents' logs."""
    ended: dict[int, tuple[int, str]] = field(default_factory=dict)
    """Exit codes of agents that have ended, each with `RunPart.outlasted`."""
    failed: str = ""
    """Why the supervisor gave up; empty if it did not."""
    is_over: bool = False
    """Whether all its agents have ended and nothing more will come."""


class WorkerLostError(Exception):
    """A worker no longer answers; the text says why, if that is known."""


class SupervisorActor:
    """The agents of one job, from their start on. Releasing the object ends them."""

    def __init__(self, job: AgentsJob) -> None:
        parent = Path(tempfile.gettempdir())
        remove_left(parent, PREFIX)
        self._folder, lock = locked_folder(parent, PREFIX)
        try:
            _write(self._folder, job)
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", supervisor.__name__, str(self._folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                start_new_session=True,  # a Ctrl-C in the worker's terminal is for the worker
                pass_fds=(lock,),  # the supervisor holds it to its end
            )
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise
        finally:
            os.close(lock)
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self._said, self._read = b"", dict.fromkeys(job.agents, 0)
        self._ends = weakref.finalize(self, _see_off, self._process, self._folder)
        self._ends.atexit = False  # this process's end closes the pipe, and no thread can be started by then

    def poll(self) -> Update:
        """Return what has happened since the last call."""
        update = Update()
        is_dead = self._process.poll() is not None
        *lines, self._said = (self._said + self._new_words()).split(b"\n")
        for line in lines:
            kind, *items = json.loads(line)
            if kind == supervisor.ENDED:
                update.ended[items[0]] = items[1], items[2]
            elif kind == supervisor.FAILED:
                update.failed = items[0]
            else:
                update.is_over = True
        if is_dead and not update.is_over:
            update.failed, update.is_over = f"its process ended with code {self._process.returncode}", True
            self._ends()
        update.logs = self._new_logs()  # after the words, so that the last lines of an agent come with its end
        return update

    def stop(self) -> None:
        """Ask the agents to end; `poll` tells when they have."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.write(STOP)

    def close(self) -> None:
        """End what still runs, and remove the agents' files."""
        self._ends()

    def _new_words(self) -> bytes:
        assert self._process.stdout is not None
        return b"" if self._process.stdout.closed else self._process.stdout.read() or b""

    def _new_logs(self) -> dict[int, bytes]:
        logs = {}
        for agent, begin in self._read.items():
            with suppress(OSError), (self._folder / supervisor.LOGS / f"agent-{agent}.log").open("rb") as file:
                file.seek(begin)
                if new := file.read(MAX_LOG_BYTES):
                    logs[agent] = new
                    self._read[agent] += len(new)
        return logs


def _write(folder: Path, job: AgentsJob) -> None:
    """Write the files of a job into a folder that only this user can read."""
    (folder / supervisor.LOGS).mkdir()
    (folder / supervisor.CA).write_bytes(job.authority)
    for agent, files in job.agents.items():
        contents = (files.settings.encode(), files.certificate, files.key)
        for ending, content in zip(supervisor.ENDINGS.values(), contents, strict=True):
            write_secret(folder / f"{agent}.{ending}", content)
    if protocol_of(job.connect) != TLS:
        raise ValueError(f"agents on other machines must connect over {TLS}/ (got {job.connect})")
    options = {"--run": job.run, "--connect": job.connect, "--zenoh": list(job.zenoh)}
    told = {"mode": job.mode, "start_timeout_s": job.start_timeout_s, "agents": [*job.agents], "options": options}
    (folder / supervisor.JOB).write_text(json.dumps(told), encoding="utf-8")


def _see_off(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Let a supervisor end, without waiting for it here, and remove what a killed one leaves."""
    assert process.stdin is not None
    process.stdin.close()
    threading.Thread(target=_remove, args=(process, folder), daemon=True).start()


def _remove(process: subprocess.Popen[bytes], folder: Path) -> None:
    try:
        process.wait(END_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()  # its agents end with it
        process.wait()
    assert process.stdout is not None
    process.stdout.close()
    shutil.rmtree(folder, ignore_errors=True)
