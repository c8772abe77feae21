"""One run from scenario to summary, by real processes or in one process."""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator import results, room
from deltaswarm_orchestrator.boards import Boards, commands
from deltaswarm_orchestrator.in_process import run_in_process
from deltaswarm_orchestrator.launch import LaunchError, StoppedError, Swarm
from deltaswarm_orchestrator.observer import Observer
from deltaswarm_orchestrator.progress import Reporter
from deltaswarm_orchestrator.recorder import Recorder
from deltaswarm_orchestrator.results import Outcome
from deltaswarm_orchestrator.room import RoomError
from deltaswarm_orchestrator.run_folder import RunFolder
from deltaswarm_orchestrator.stopping import Stop, stoppable
from deltaswarm_orchestrator.watch import Watch
from deltaswarm_wire import checked
from deltaswarm_wire.settings import Scenario


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
    """What the user should know: what was lost, and the last lines of the logs."""


def run(scenario: Scenario, options: RunOptions, reporter: Reporter) -> RunResult:
    """Do one run and write its folder.

    Raises:
        FolderError: the folder cannot be had.
        FolderTakenError: it could not get its name in the end.
        SettingsError: the scenario cannot be run with these boards.
    """
    with stoppable() as stop:
        if options.boards:
            options.boards.prepare(scenario)
        with RunFolder(options.out, force=options.force) as folder:
            return _run_into(folder, scenario, options, reporter, stop)


@dataclass
class _Story:
    """What becomes of a run."""

    outcome: Outcome | None = None
    why: list[str] = field(default_factory=list)
    """Why it ended too early, or what was lost on the way; each a line."""
    logs: list[str] = field(default_factory=list)
    operator_restarts: int = 0


def _run_into(folder: RunFolder, scenario: Scenario, options: RunOptions, reporter: Reporter, stop: Stop) -> RunResult:
    """Do one run and fill its folder."""
    manifest = results.new_manifest(scenario, "in-process" if options.in_process else "processes", scenario.record)
    folder.begin(scenario, manifest)
    if warning := room.shortage(folder.path, scenario):
        reporter.say(f"warning: {warning}")
    story = _Story()
    summary: dict[str, Any] = {}
    try:
        room.keep_reserve(folder.path)
        with _recorder(folder.path, scenario) as recorder:
            try:
                _do(scenario, options, folder.path, recorder, reporter, stop, story)
            finally:
                room.give_up_reserve(folder.path)
                summary = _conclude(folder.path, scenario, manifest, stop, story)
            if recorder is not None:
                recorder.close(manifest)
        with room.room_for(folder.path):
            results.write_tables(folder.path, story.outcome or Outcome())
    except RoomError as error:
        story.why.append(str(error))
        room.give_up_reserve(folder.path)
        summary = _conclude(folder.path, scenario, manifest, stop, story) | {"valid": False}
        summary["invalid_because"].append(str(error))
    results.write_json(folder.path / "summary.json", summary)
    folder.write_manifest(manifest)
    return RunResult(folder.finish(), summary, str(manifest["exit_reason"]), tuple(story.why + story.logs))


def _do(
    scenario: Scenario,
    options: RunOptions,
    folder: Path,
    recorder: Recorder | None,
    reporter: Reporter,
    stop: Stop,
    story: _Story,
) -> None:
    """All steps, by real processes or in one."""
    if options.in_process:
        story.outcome = run_in_process(scenario, recorder, reporter, lambda: stop.by)
        story.why += story.outcome.messages
        return
    try:
        _run_processes(scenario, options, folder, recorder, reporter, stop, story)
    except (LaunchError, ConnectionError) as error:
        story.why.append(str(error))
    except StoppedError:
        pass
    except KeyboardInterrupt:
        story.why.append("a second signal came: nothing was waited for")


def _conclude(folder: Path, scenario: Scenario, manifest: dict[str, Any], stop: Stop, story: _Story) -> dict[str, Any]:
    """The summary; the manifest gets what agrees with it."""
    if story.outcome is None:
        story.outcome = results.read_outcome(folder)
    summary = results.summary(story.outcome, scenario)
    reason = "finished" if summary["complete"] else f"stopped by {stop.by}" if stop.by else "failed"
    if not summary["complete"]:
        summary["invalid_because"][0] += f": {reason}"
    ending = {"exit_reason": reason, "why": story.why, "operator_restarts": story.operator_restarts}
    manifest |= {**ending, "digest": summary["digest"], "complete": summary["complete"]}
    return {**summary, **ending}


@contextmanager
def _recorder(folder: Path, scenario: Scenario) -> Iterator[Recorder | None]:
    """The recorder that the scenario asks for, if any."""
    if scenario.record == "off":
        yield None
        return
    with Recorder(folder, checked.plain(scenario), scenario, wire=scenario.record == "wire") as recorder:
        yield recorder


def _run_processes(
    scenario: Scenario,
    options: RunOptions,
    folder: Path,
    recorder: Recorder | None,
    reporter: Reporter,
    stop: Stop,
    story: _Story,
) -> None:
    """Launch, watch, end.

    Raises:
        LaunchError, ConnectionError: a part did not come up.
        StoppedError: somebody asked for the end before all were there.
        RoomError: the recording could not be written.
    """
    boards = options.boards
    # A board's file holds for the next run too; the router, with its own port, is one run's alone.
    name = scenario.name if boards else f"{scenario.name}-{secrets.token_hex(4)}"
    who = boards.agents if boards else ()
    with Swarm(scenario, name, folder, options.zenoh, who, lambda: stop.by) as swarm:
        swarm.start_world(
            folder / "scenario.toml",
            listen=options.listen,
            record=recorder is not None,
            wire=scenario.record == "wire",
            for_boards=boards.listen if boards else "",
            tls=boards.tls if boards else None,
        )
        if boards:
            reporter.say(commands(boards.write(name, swarm.endpoints[-1], scenario, swarm.password)))
        with Observer(name, swarm.recorder_link(), recorder, wire=scenario.record == "wire") as observer:
            watch = Watch(swarm, observer, reporter, stop, scenario.run.step_timeout_s)
            try:
                swarm.start_operator(publish_all=recorder is not None)
                swarm.start_agents()
                swarm.write_pids()
                watch.to_the_end()
            finally:
                story.why += watch.why
                story.logs += [f"the last lines of the log of {name}:\n{tail}" for name, tail in watch.logs.items()]
                story.operator_restarts = watch.operator_restarts
