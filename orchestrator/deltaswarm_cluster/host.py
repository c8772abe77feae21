"""A host of agents on one machine: it starts their processes, and says what becomes of them.

On a cluster this object is an actor on each worker. Whatever ends it (the run, the loss of the client or of the
scheduler, the death of the worker) closes the standard input of its process, which ends the agents.
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
from pathlib import Path

from deltaswarm_cluster import host_process
from deltaswarm_cluster.host_job import HostJob, News
from deltaswarm_wire.access import TLS
from deltaswarm_wire.endpoints import protocol_of
from deltaswarm_wire.files import write_secret

END_WITHIN_S = 12.0
"""Time that the process of a host may take to end its agents [s]."""

MAX_LOG_BYTES = 1 << 20
"""Maximum number of bytes of an agent's log in one piece of news."""

STOP = b"stop\n"


class AgentHost:
    """The agents of one job, from their start on. Releasing the object ends them."""

    def __init__(self, job: HostJob) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="deltaswarm-agents-"))  # of mode 0700
        try:
            _write(self._folder, job)
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", host_process.__name__, str(self._folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                start_new_session=True,  # a Ctrl-C in the worker's terminal is for the worker
            )
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self._said, self._read = b"", dict.fromkeys(job.agents, 0)
        self._ends = weakref.finalize(self, _see_off, self._process, self._folder)
        self._ends.atexit = False  # this process's end closes the pipe, and no thread can be started by then

    def poll(self) -> News:
        """Return what has happened since the last call."""
        news = News()
        is_dead = self._process.poll() is not None
        *lines, self._said = (self._said + self._new_words()).split(b"\n")
        for line in lines:
            kind, *items = json.loads(line)
            if kind == host_process.ENDED:
                news.ended[items[0]] = items[1]
            elif kind == host_process.FAILED:
                news.failed = items[0]
            else:
                news.is_over = True
        if is_dead and not news.is_over:
            news.failed, news.is_over = f"its process ended with code {self._process.returncode}", True
            self._ends()
        news.logs = self._new_logs()  # after the words, so that the last lines of an agent come with its end
        return news

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
            with suppress(OSError), (self._folder / host_process.LOGS / f"agent-{agent}.log").open("rb") as file:
                file.seek(begin)
                if new := file.read(MAX_LOG_BYTES):
                    logs[agent] = new
                    self._read[agent] += len(new)
        return logs


def _write(folder: Path, job: HostJob) -> None:
    """Write the files of a job into a folder that only this user can read."""
    (folder / host_process.LOGS).mkdir()
    (folder / host_process.CA).write_bytes(job.authority)
    for agent, files in job.agents.items():
        contents = (files.settings.encode(), files.certificate, files.key)
        for ending, content in zip(host_process.ENDINGS.values(), contents, strict=True):
            write_secret(folder / f"{agent}.{ending}", content)
    if protocol_of(job.connect) != TLS:
        raise ValueError(f"agents on other machines must connect over {TLS}/ (got {job.connect})")
    options = {"--run": job.run, "--connect": job.connect, "--zenoh": list(job.zenoh)}
    told = {"mode": job.mode, "start_timeout_s": job.start_timeout_s, "agents": [*job.agents], "options": options}
    (folder / host_process.JOB).write_text(json.dumps(told), encoding="utf-8")


def _see_off(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Let a host's process end, without waiting for it here, and remove what a killed one leaves."""
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
