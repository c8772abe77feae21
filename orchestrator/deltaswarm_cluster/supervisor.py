"""Supervise the agents on one worker: `python -m deltaswarm_cluster.supervisor FOLDER`.

It starts the agents of `job.json` from a fork server, each as a process of its own, and prints a JSON list for each
end. Closing its standard input, which the death of its own parent does too, ends the agents and removes the folder with
their keys. If it is killed, too, the agents remove their keys as they end.
"""

import json
import os
import select
import shutil
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import limits
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.kernel import adopt_orphans
from deltaswarm_orchestrator.processes.entry_point import SECRETS_VARIABLE
from deltaswarm_orchestrator.processes.fork_server import fork_server_problem
from deltaswarm_orchestrator.processes.process import wait_for
from deltaswarm_orchestrator.processes.starter import LaunchError, Starter
from deltaswarm_wire.keys import AGENT

JOB, LOGS = "job.json", "logs"
"""The supervisor's job and the folder of the agents' logs, in its own folder."""

CA = "ca.pem"
ENDINGS = {"settings": "toml", "certificate": "pem", "key": "key"}
"""The endings of an agent's files, by the option that takes them."""

ENDED, FAILED, OVER = "ended", "failed", "over"
"""The first items of what it prints: followed by an agent and its exit code, by a text, by nothing."""

POLL_S = 0.1
LEAVE_WITHIN_S = 2.0
"""Time for agents to end by themselves when the run is over [s]: the world's last words are on their way to them."""


def main(argv: Sequence[str]) -> int:
    """Start the agents of a folder, and end them when asked to."""
    folder = Path(argv[0])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[SECRETS_VARIABLE] = str(folder)
    try:
        _Supervisor(folder, json.loads((folder / JOB).read_text(encoding="utf-8"))).serve()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 0


class _Supervisor:
    def __init__(self, folder: Path, job: dict[str, Any]) -> None:
        self._folder, self._job = folder, job
        self._starter = Starter(folder / LOGS, job["mode"], job["start_timeout_s"], lambda: False)
        self._told: set[int] = set()
        self._is_orphan = False
        """Whether the parent has closed its end of standard input."""

    def serve(self) -> None:
        """Start the agents; end them once asked to, and stay until nobody needs their logs any more."""
        try:
            try:
                self._start()
            except (CommandError, LaunchError) as error:
                _say(FAILED, str(error))
            while not self._is_asked(POLL_S):
                self._tell_ends()
            if not self._is_orphan:
                wait_for(self._starter.parts, LEAVE_WITHIN_S)
        finally:
            self._starter.end(at_once=self._is_orphan)
        self._tell_ends()
        _say(OVER)
        while not self._is_orphan:
            self._is_asked(None)

    def _start(self) -> None:
        agents = self._job["agents"]
        if problem := fork_server_problem():
            raise LaunchError(problem)
        limits.make_room(len(agents))
        adopt_orphans(do_so=True)
        for agent in agents:
            files = {f"--{kind}": self._folder / f"{agent}.{ending}" for kind, ending in ENDINGS.items()}
            options = {"--id": agent, "--ca": self._folder / CA, **files, **self._job["options"]}
            self._starter.start(AGENT, agent, options)

    def _is_asked(self, within_s: float | None) -> bool:
        """Wait for a request to end; return whether there is one, by words or because the parent has gone."""
        if not select.select([sys.stdin], [], [], within_s)[0]:
            return False
        self._is_orphan = not os.read(sys.stdin.fileno(), 1024)
        return True

    def _tell_ends(self) -> None:
        for part in self._starter.parts:
            if part.number not in self._told and (code := part.exit_code) is not None:
                self._told.add(part.number)
                _say(ENDED, part.number, code, part.outlasted)


def _say(*items: object) -> None:
    with suppress(OSError):  # the parent has gone
        print(json.dumps(items), flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
