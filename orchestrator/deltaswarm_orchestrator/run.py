"""One run from scenario to summary, by real processes or in one process."""

import secrets
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from deltaswarm_orchestrator import results
from deltaswarm_orchestrator.boards import Boards, commands
from deltaswarm_orchestrator.in_process import run_in_process
from deltaswarm_orchestrator.launch import END_WITHIN_S, LaunchError, Part, Swarm
from deltaswarm_orchestrator.observer import Observer
from deltaswarm_orchestrator.progress import Reporter
from deltaswarm_orchestrator.recorder import Recorder
from deltaswarm_orchestrator.results import Outcome
from deltaswarm_orchestrator.run_folder import RunFolder
from deltaswarm_wire import checked
from deltaswarm_wire.keys import OPERATOR, WORLD
from deltaswarm_wire.settings import Scenario

POLL_S = 0.1
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@dataclass(frozen=True)
class RunOptions:
    """How a run is done, apart from what it is (the scenario)."""

    out: Path
    in_process: bool = False
    force: bool = False
    listen: str = "tcp/127.0.0.1:0"
    zenoh: tuple[tuple[str, str], ...] = ()
    boards: Boards | None = None
    """Agents that are started elsewhere, by hand."""


@dataclass(frozen=True)
class RunResult:
    """What a finished run gives its caller."""

    folder: Path
    summary: dict[str, Any]
    exit_reason: str
    messages: tuple[str, ...]
    """What the user should know: parts that were lost, with the last lines of their logs."""


class _Stop:
    """Notes that somebody asked for the end."""

    def __init__(self) -> None:
        self.by: str | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.by = signal.Signals(number).name


def run(scenario: Scenario, options: RunOptions, reporter: Reporter) -> RunResult:
    """Do one run and write its folder.

    Raises:
        FolderError: the folder cannot be had.
        FolderTakenError: it could not get its name in the end.
        SettingsError: the scenario cannot be run with these boards.
    """
    if options.boards:
        options.boards.prepare(scenario)
    with RunFolder(options.out, force=options.force) as folder:
        return _run_into(folder, scenario, options, reporter)


def _run_into(folder: RunFolder, scenario: Scenario, options: RunOptions, reporter: Reporter) -> RunResult:
    """Do one run and fill its folder."""
    engine = "in-process" if options.in_process else "processes"
    manifest = results.new_manifest(scenario, engine, scenario.record)
    folder.begin(scenario, manifest)
    messages: list[str] = []
    with _recorder(folder.path, scenario) as recorder, _stoppable() as stop:
        if options.in_process:
            outcome, reason = run_in_process(scenario, recorder, reporter, lambda: stop.by), "finished"
            messages += outcome.messages
        else:
            outcome, reason = _run_processes(scenario, options, folder.path, recorder, reporter, stop, messages)
        if stop.by:
            reason = f"stopped by {stop.by}"
        summary = results.summary(outcome, scenario)
        manifest |= {
            "exit_reason": reason if outcome.is_complete or reason != "finished" else "failed",
            "digest": summary["digest"],
            "complete": summary["complete"],
        }
        if recorder is not None:
            recorder.close(manifest)
    results.write_tables(folder.path, outcome)
    results.write_json(folder.path / "summary.json", summary)
    folder.write_manifest(manifest)
    return RunResult(folder.finish(), summary, str(manifest["exit_reason"]), tuple(messages))


@contextmanager
def _recorder(folder: Path, scenario: Scenario) -> Iterator[Recorder | None]:
    """The recorder that the scenario asks for, if any."""
    if scenario.record == "off":
        yield None
        return
    with Recorder(folder, checked.plain(scenario), scenario, wire=scenario.record == "wire") as recorder:
        yield recorder


@contextmanager
def _stoppable() -> Iterator[_Stop]:
    """Ctrl-C, SIGTERM and a closed terminal ask for an orderly end; a second one is not waited for."""
    stop = _Stop()
    before = {number: signal.signal(number, stop) for number in STOP_SIGNALS}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _run_processes(
    scenario: Scenario,
    options: RunOptions,
    folder: Path,
    recorder: Recorder | None,
    reporter: Reporter,
    stop: _Stop,
    messages: list[str],
) -> tuple[Outcome, str]:
    """Launch, watch, end; the outcome and the exit reason."""
    boards = options.boards
    # A board's file holds for the next run too; the router, with its own port, is one run's alone.
    name = scenario.name if boards else f"{scenario.name}-{secrets.token_hex(4)}"
    reason = "finished"
    with Swarm(scenario, name, folder, options.zenoh, boards.agents if boards else ()) as swarm:
        try:
            swarm.start_world(
                folder / "scenario.toml",
                listen=options.listen,
                record=recorder is not None,
                for_boards=boards.listen if boards else "",
                tls=boards.tls if boards else None,
            )
            if boards:
                reporter.say(commands(boards.write(name, swarm.endpoints[-1], scenario, swarm.password)))
            with Observer(
                name, swarm.recorder_link(), recorder, wire=scenario.record == "wire", uplink=scenario.uplink.is_on
            ) as observer:
                swarm.start_operator(publish_all=recorder is not None)
                swarm.start_agents()
                swarm.write_pids()
                reason = _watch(swarm, observer, reporter, stop, messages)
        except (LaunchError, ConnectionError) as error:
            messages.append(str(error))
            reason = "failed"
    return results.read_outcome(folder), reason


def _watch(swarm: Swarm, observer: Observer, reporter: Reporter, stop: _Stop, messages: list[str]) -> str:
    """Until the world has ended: take what is heard, show it, notice who is gone."""
    noted: set[Part] = set()
    stopping = False
    deadline = float("inf")
    while True:
        observer.work(POLL_S)
        if observer.status is not None:
            workload = observer.newest_workload
            reporter.update(observer.status, workload.rate_60s_hz if workload else None)
        if stop.by and not stopping:
            stopping = True
            deadline = time.monotonic() + END_WITHIN_S / 2
            swarm.stop_world()
        while observer.orders:
            order = observer.orders.popleft()
            swarm.carry_out(order)
            observer.confirm(order)
        observer.leave_when_done()
        failed = _failed(swarm, noted)
        if not stopping:
            messages += map(_obituary, failed)
        if failed and not _has_begun(observer):
            swarm.stop_world()  # it would wait for them in vain
        if any(part.role == OPERATOR for part in failed):
            deadline = min(deadline, time.monotonic() + END_WITHIN_S / 2)
        if swarm.part(WORLD).process.exitcode is not None or time.monotonic() > deadline:
            break
    while observer.work(0.0):
        pass
    if not stopping:  # a world that failed just now is why others did
        messages[:0] = map(_obituary, _failed(swarm, noted))
    unfinished = swarm.part(WORLD).process.exitcode != 0 or swarm.part(OPERATOR).process.exitcode not in (0, None)
    return "failed" if unfinished else "finished"


def _has_begun(observer: Observer) -> bool:
    """Whether the first step is under way."""
    return observer.status is not None and observer.status.phase != "waiting"


def _failed(swarm: Swarm, noted: set[Part]) -> list[Part]:
    """Who has ended since, and not as planned."""
    ended = [part for part in swarm.ended() if part not in noted]
    noted.update(ended)
    return [part for part in ended if part.process.exitcode != 0 and not part.ends_as_planned]


def _obituary(part: Part) -> str:
    code = part.process.exitcode or 0
    how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
    return f"{part.name} {how}; the last lines of its log:\n{part.log_tail()}"
