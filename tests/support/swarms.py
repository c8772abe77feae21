"""Real swarms for tests: started by the command line, found by their process ids, waited for by condition."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.keys import WORLD

COMMAND = [sys.executable, "-m", "deltaswarm_orchestrator"]
POLL_S = 0.02
SMOKE_PROCESSES = 8
"""World, operator and six agents of the scenario `smoke`."""

UNHURRIED = ("--set", "control.mode=tests.support.unhurried:Unhurried")
"""Options of a run that decides as `smoke` does and lasts long enough, without many steps, to be watched or struck."""

PATIENCE_S = 240.0
"""Guards against waiting for ever. No test needs the machine to be quick: it waits for facts, and this long."""

BOUND_S = 60.0
"""Far above what an ending may take (start_timeout_s or step_timeout_s, and ten seconds) on a machine of its own."""


def sets(*pairs: str) -> list[str]:
    """Options that set these keys."""
    return [word for pair in pairs for word in ("--set", pair)]


def wait_until(condition: Callable[[], Any], what: str, within_s: float = PATIENCE_S) -> Any:
    """The condition's first true value; fails loudly when time is up."""
    deadline = time.monotonic() + within_s
    while not (found := condition()):
        assert time.monotonic() < deadline, f"not within {within_s} s: {what}"
        time.sleep(POLL_S)
    return found


def stat(pid: int) -> list[str]:
    """The fields of /proc/PID/stat from the third on: state, parent, and so on.

    Raises:
        OSError: there is no such process.
    """
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()


def kill(pids: Iterable[int]) -> None:
    """End processes at once, of which some may just have ended."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def is_running(pid: int) -> bool:
    """Whether a process exists and is not a zombie."""
    try:
        return stat(pid)[0] != "Z"
    except OSError:
        return False


def parent_of(pid: int) -> int:
    """The parent of a process.

    Raises:
        OSError: there is no such process.
    """
    return int(stat(pid)[1])


class RunningSwarm:
    """A run under way."""

    def __init__(self, process: subprocess.Popen[str], out: Path) -> None:
        self.process = process
        self.out = out
        self.part = out.with_name(out.name + ".part")

    @property
    def pids(self) -> dict[str, int]:
        """Processes by name ("agent 3", "world", "operator")."""
        try:
            text = (self.part / "logs" / "pids.json").read_text()
        except OSError:
            return {}
        return dict(json.loads(text))  # it is whole whenever it is there

    def steps(self) -> int:
        """Steps that have reached the world's table."""
        try:
            return max(0, (self.part / "world.csv").read_text().count("\n") - 1)
        except OSError:
            return 0

    def wait_for_steps(self, steps: int) -> None:
        """Until so many more steps are on file."""
        wanted = self.steps() + steps
        wait_until(lambda: self.steps() >= wanted or self.process.poll() is not None, f"{wanted} steps")
        assert self.process.poll() is None, self.process.communicate()

    def wait_until_under_way(self, processes: int = SMOKE_PROCESSES) -> dict[str, int]:
        """Wait for all processes and a first step; return the process ids by name."""
        wait_until(lambda: len(self.pids) == processes or self.process.poll() is not None, "all processes")
        self.wait_for_steps(1)
        return self.pids

    def log(self, role: str, number: int = 0) -> str:
        """A part's log."""
        folder = self.part if self.part.exists() else self.out
        return (folder / "logs" / f"{role}-{number}.log").read_text()

    def interrupt(self, number: signal.Signals = signal.SIGINT) -> None:
        """End the run early, as Ctrl-C in its terminal does."""
        os.killpg(self.process.pid, number)

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to one part."""
        os.kill(self.pids[name], number)

    def finish(self, within_s: float = PATIENCE_S) -> tuple[int, str, str]:
        """Exit code, standard output, standard error."""
        out, err = self.process.communicate(timeout=within_s)
        return self.process.returncode, out, err

    def end_well(self, within_s: float = PATIENCE_S) -> str:
        """Standard error of a run that ends with exit code 0."""
        code, printed, errors = self.finish(within_s)
        assert code == 0, errors + printed
        return errors

    def end_without(self, *agents: int) -> str:
        """Standard error of a run that is not valid because these agents failed."""
        code, printed, errors = self.finish()
        assert code == 1, errors + printed
        summary = self.summary()
        assert [row["agent"] for row in summary["agents_failed"]] == [*agents]
        assert not summary["valid"]
        for agent in agents[:5]:
            assert re.search(rf"not valid: agent {agent} failed in step \d+ ", errors)
        return errors

    def summary(self) -> dict[str, Any]:
        """The finished run's summary."""
        return dict(json.loads((self.out / "summary.json").read_text()))

    def manifest(self) -> dict[str, Any]:
        """The finished run's manifest."""
        return dict(json.loads((self.out / "manifest.json").read_text()))


def heeds(pid: int, number: signal.Signals = signal.SIGINT) -> bool:
    """Whether a process catches or ignores a signal: as soon as Python runs in it, it does so with Ctrl-C."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return False
    masks = [int(line.split()[1], 16) for line in lines if line.startswith(("SigIgn", "SigCgt"))]
    return any(mask & 1 << (number - 1) for mask in masks)


def running(
    out: Path, *arguments: str, scenario: str = "smoke", inside: Sequence[str] = ()
) -> AbstractContextManager[RunningSwarm]:
    """A run by the command line; `inside` is the command that runs another one elsewhere."""
    return under_way(out, *inside, *COMMAND, "run", scenario, "--out", str(out), *arguments)


@contextmanager
def under_way(out: Path, *command: str) -> Iterator[RunningSwarm]:
    """A run by a command, with nothing left of it afterwards, whatever the test does."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    swarm = RunningSwarm(process, out)
    pids: dict[str, int] = {}
    try:
        yield swarm
    finally:
        pids = swarm.pids
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        kill(pids.values())


def told(*arguments: str, inside: Sequence[str] = (), **options: Any) -> subprocess.CompletedProcess[str]:
    """Run `deltaswarm` to its end, whatever its exit code, and keep what it says."""
    return subprocess.run([*inside, *COMMAND, *arguments], capture_output=True, text=True, check=False, **options)


def wait_for_end(swarm: Swarm, observer: Observer, within_s: float = PATIENCE_S) -> None:
    """Take what a run under way says, until its world has ended."""

    def has_ended() -> bool:
        observer.work(0.01)
        observer.leave_when_done()
        return swarm.part(WORLD).exit_code is not None

    wait_until(has_ended, "the end of the run", within_s)


def run(out: Path, *arguments: str, scenario: str = "smoke") -> dict[str, Any]:
    """A whole run; its summary. Fails with the run's own words if it fails."""
    with running(out, *arguments, scenario=scenario) as swarm:
        swarm.end_well()
        return swarm.summary()


@contextmanager
def started(
    scenario: Scenario,
    run: str,
    folder: Path,
    agents: Iterable[int] | None = None,
    zenoh: Sequence[tuple[str, str]] = (),
) -> Iterator[tuple[Swarm, Observer]]:
    """World, operator and agents (default: all) as the orchestrator starts them, and the observer of their run."""
    file = folder / "scenario.toml"
    file.write_text(to_toml(scenario))
    with Swarm(scenario, run, folder, zenoh) as swarm:
        swarm.start_world("tcp/127.0.0.1:0")
        with Observer(run, swarm.recorder_link(), None, wire=False) as observer:
            swarm.start_operator(publish_all=False)
            swarm.start_agents(agents)
            yield swarm, observer
