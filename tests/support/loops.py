"""Runs with hardware in the loop: the swarm by the command line, the boards as processes that a test starts."""

import os
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import tomli_w

from tests.support.swarms import PATIENCE_S, RunningSwarm, running, wait_until


class Loop:
    """A run under way, and its boards."""

    def __init__(self, swarm: RunningSwarm, folder: Path, inside: Sequence[str]) -> None:
        self.swarm = swarm
        self.folder = folder
        """What the run wrote for its boards."""
        self.processes: dict[int, subprocess.Popen[bytes]] = {}
        self._inside = inside

    def wait_for_files(self, agents: Sequence[int]) -> None:
        """Until the run has written what boards need; the last file is that of the last board."""
        file = self.folder / f"{agents[-1]}.toml"
        wait_until(lambda: file.exists() or self.swarm.process.poll() is not None, f"{file}")
        assert self.swarm.process.poll() is None, self.swarm.finish()
        wait_until(lambda: "agent" in self.settings(agents[-1]), f"{file}, whole")

    def settings(self, agent: int) -> dict[str, Any]:
        """A board's file."""
        return tomllib.loads((self.folder / f"{agent}.toml").read_text())

    def start(self, agent: int, **air: Any) -> None:
        """A board, with settings of the air changed."""
        file = self.folder / f"{agent}.toml"
        if air:
            table = self.settings(agent)
            table["air"] |= air
            file.write_text(tomli_w.dumps(table))
        command = [*self._inside, sys.executable, "-P", "-m", "deltaswarm_board", str(file)]
        with (self.folder / f"{agent}.err").open("ab") as said:
            self.processes[agent] = subprocess.Popen(command, stderr=said)

    def said(self, agent: int) -> str:
        """What a board has written to standard error."""
        return (self.folder / f"{agent}.err").read_text()

    def kill(self, agent: int) -> None:
        """As if its power went."""
        process = self.processes.pop(agent)
        process.kill()
        process.wait()

    def wait_for_the_world(self, text: str, within_s: float = PATIENCE_S) -> None:
        """Until the world's log has this text."""
        wait_until(lambda: text in self.swarm.log("world"), f"the world says {text!r}", within_s)

    def finish(self, within_s: float = PATIENCE_S) -> dict[str, Any]:
        """The summary of a run that is valid; the boards end with it."""
        code, printed, errors = self.swarm.finish(within_s)
        assert code == 0, errors + printed + self.swarm.log("world")
        for agent, process in self.processes.items():
            assert process.wait(PATIENCE_S) == 0, self.said(agent)
        return self.swarm.summary()

    def stop(self) -> dict[str, Any]:
        """Interrupt a run in which all that it was for has happened; its summary. The boards end with it.

        Left out of the reasons why the run is not valid is that it did not come to its last step.
        """
        self.swarm.interrupt()
        _, printed, errors = self.swarm.finish()
        for agent, process in self.processes.items():
            assert process.wait(PATIENCE_S) == 0, (self.said(agent), errors, printed)
        summary = self.swarm.summary()
        assert not summary["complete"]
        reasons = summary["invalid_because"][1:]
        return summary | {"invalid_because": reasons, "valid": not reasons}


@contextmanager
def loop(
    folder: Path,
    agents: Sequence[int],
    *arguments: str,
    scenario: str = "smoke",
    inside: Sequence[str] = (),
    boards_inside: Sequence[str] = (),
) -> Iterator[Loop]:
    """A run that waits for boards, of which none is left afterwards."""
    named = f"--boards={','.join(map(str, agents))}"
    with running(folder / "run", named, *arguments, scenario=scenario, inside=inside) as swarm:
        made = Loop(swarm, folder / "run.boards", boards_inside)
        try:
            made.wait_for_files(agents)
            yield made
        finally:
            for process in made.processes.values():
                process.send_signal(signal.SIGCONT)
                process.kill()
                process.wait()


def mode(file: Path) -> int:
    """Who may do what with a file."""
    return os.stat(file).st_mode & 0o777
