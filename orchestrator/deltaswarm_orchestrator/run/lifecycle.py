"""One run from scenario to summary, in real processes or in one process."""

import json
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import disk, provenance
from deltaswarm_orchestrator.base.disk import RoomError
from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, OK, CommandError
from deltaswarm_orchestrator.base.signals import Stop, decide, stoppable
from deltaswarm_orchestrator.boards.files import Boards, commands
from deltaswarm_orchestrator.live.foxglove_server import FoxgloveServer, check_installed
from deltaswarm_orchestrator.live.onlookers import Onlooker, Tap
from deltaswarm_orchestrator.live.pictures import LiveSocket, ResearcherFeed
from deltaswarm_orchestrator.live.thinning import ViewersOnly
from deltaswarm_orchestrator.processes.launch import LaunchError, StoppedError, Swarm
from deltaswarm_orchestrator.processes.station import Station, announce
from deltaswarm_orchestrator.recording.layout import LAYOUT, layout_json
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.results import resume, run_tables
from deltaswarm_orchestrator.results.folder import ResumedFolder, RunFolder, check_target
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.reporter import Reporter
from deltaswarm_orchestrator.run.watch import Watch
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checkpoint
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.files import sync_folder

STOPPED_BY = "stopped by"
AT_ONCE = "a second signal ended the run at once"


@dataclass(frozen=True)
class RunOptions:
    """How to do a run; what to run is the scenario."""

    out: Path
    in_process: bool = False
    force: bool = False
    listen: str = "tcp/127.0.0.1:0"
    zenoh: tuple[tuple[str, str], ...] = ()
    boards: Boards | None = None
    """Agents that are started by hand on other machines."""
    checkpoint_steps: int = 0
    """Steps between checkpoints, from which the run can be resumed; 0: no checkpoints."""
    station: Station | None = None
    """The page of the person who watches and commands; None: no station."""
    researcher: bool = False
    """Whether to serve another page, which shows the truth."""
    resume: bool = False
    """Resume the interrupted run in `out` from its newest checkpoint."""
    live_port: int | None = None
    """Port on which to show the run live to Foxglove; 0: any free port; None: do not show it."""


@dataclass(frozen=True)
class RunResult:
    """The result of a run that has ended."""

    folder: Path
    summary: dict[str, Any]
    exit_reason: str
    messages: tuple[str, ...]
    """Messages for the user: what went wrong, the last lines of logs, and how to resume."""

    @property
    def code(self) -> int:
        """The exit code that tells how the run ended."""
        if self.summary["valid"]:
            return OK
        return INTERRUPTED if self.exit_reason.startswith(STOPPED_BY) else FAILED


def check(scenario: Scenario, options: RunOptions) -> None:
    """Check what can be checked of a run before anything is started or written.

    Raises:
        FolderError: the folder exists.
        SettingsError: the scenario cannot be run with these boards, or has a bound that processes cannot compute.
        LiveError: the run cannot be shown live.
    """
    if scenario.run.bound != "none" and not options.in_process:
        allowed = "must be none for a run of processes: no agent can know what a bound knows; use --in-process"
        raise SettingsError([Problem("run.bound", repr(scenario.run.bound), allowed)])
    if options.boards:
        options.boards.check(scenario)
    if options.live_port is not None:
        check_installed()
    if not options.resume:
        check_target(options.out, options.force)


def run(scenario: Scenario, options: RunOptions, reporter: Reporter) -> RunResult:
    """Do one run and write its folder.

    Raises:
        FolderError: the folder cannot be taken, or has no checkpoint to resume from.
        FolderTakenError: the folder could not be given its final name.
        SettingsError: the scenario cannot be run with these boards, or has a bound that processes cannot compute.
        LiveError: the run cannot be shown live.
        RoomError: the disk is too full to write how the run ended.
        CommandError: the user asked to stop twice before the run began.
    """
    check(scenario, options)
    with stoppable() as stop:
        try:
            with disk.room_in(options.out), _viewer(scenario, options, reporter) as viewer:
                return _run(scenario, options, reporter, stop, viewer)
        except KeyboardInterrupt:
            raise CommandError(f"{STOPPED_BY} {stop.by}", INTERRUPTED) from None


def _run(
    scenario: Scenario, options: RunOptions, reporter: Reporter, stop: Stop, viewer: FoxgloveServer | None
) -> RunResult:
    if options.boards:
        options.boards.prepare(scenario)
    if options.resume:
        resume.check_inputs(options.out, scenario)  # before the folder is touched
        with ResumedFolder(options.out) as folder:
            resume.wait_for_leftovers(folder.path)
            return _Run(scenario, options, folder, reporter, stop, viewer, resume.newest(folder.path)).do()
    with RunFolder(options.out, force=options.force) as folder:
        return _Run(scenario, options, folder, reporter, stop, viewer).do()


@contextmanager
def _viewer(scenario: Scenario, options: RunOptions, reporter: Reporter) -> Iterator[FoxgloveServer | None]:
    """Yield the server for live viewers, or None if the run has none."""
    if options.live_port is None:
        yield None
        return
    with FoxgloveServer(scenario.name, options.live_port, reporter.say) as server:
        reporter.say(f"live: open {server.url} in Foxglove; it shows the truth, which the operator does not know")
        yield server


class _Run:
    """One run and its outcome."""

    def __init__(
        self,
        scenario: Scenario,
        options: RunOptions,
        folder: RunFolder,
        reporter: Reporter,
        stop: Stop,
        viewer: FoxgloveServer | None,
        resumed: Resumed | None = None,
    ) -> None:
        self._scenario = scenario
        self._options = options
        self._folder = folder
        self._reporter = reporter
        self._stop = stop
        self._viewer = viewer
        self._onlookers: list[Onlooker] = [viewer] if viewer else []
        self._resumed = resumed
        self._outcome: Outcome | None = None
        self._why: list[str] = []
        """Reasons why the run ended too early, and what was lost, one line each."""
        self._logs: list[str] = []
        self._operator_restarts = 0
        self._disk_is_full = False
        if resumed:
            self._manifest = json.loads((folder.path / "manifest.json").read_text())
            self._manifest |= {"exit_reason": run_tables.RUNNING}
            self._manifest["resumed"] = [*self._manifest["resumed"], {"at": provenance.now(), "step": resumed.step}]
        else:
            engine = "in-process" if options.in_process else "processes"
            self._manifest = run_tables.new_manifest(scenario, engine, scenario.record)
            self._manifest |= {"checkpoint_steps": options.checkpoint_steps, "resumed": []}
        self._checkpoint_steps: int = self._manifest["checkpoint_steps"]

    def do(self) -> RunResult:
        """Do all steps, then write tables, summary and manifest.

        A signal after the last step comes too late to change the recorded outcome.
        """
        folder = self._folder.path
        summary: dict[str, Any] = {}
        try:
            with disk.room_in(folder):
                self._begin()
                with self._recorder() as recorder:
                    self._do_steps(recorder)
                    summary = self._conclude()
                    if isinstance(recorder, Recorder):
                        recorder.complete(self._manifest, run_tables.person_tables(folder))
                self._write_tables()
        except (RoomError, KeyboardInterrupt) as error:
            self._stop.conclude()
            if not (self._disk_is_full and isinstance(error, RoomError)):
                self._why.append(str(error) or AT_ONCE)
            summary = self._conclude()
            if summary["complete"]:
                summary |= {"valid": False, "invalid_because": [*summary["invalid_because"], str(error)]}
        finally:
            disk.give_up_reserve(folder)  # not earlier: recording and tables could use it up
        self._folder.write_manifest(self._manifest)  # first: without it nobody knows how the run ended
        run_tables.write_json(folder / "summary.json", summary)
        path = self._folder.finish()
        hint = [f"to go on from the last checkpoint: deltaswarm run --resume {path}"] if self._can_go_on(path) else []
        messages = (*self._why, *self._logs, *hint)
        result = RunResult(path, summary, str(self._manifest["exit_reason"]), messages)
        decide(result.code)
        return result

    def _begin(self) -> None:
        """Prepare the folder for the first step."""
        folder = self._folder.path
        if warning := disk.shortage(folder, self._scenario):
            self._reporter.say(f"warning: {warning}")
        if self._resumed:
            self._folder.go_on(self._manifest)
        else:
            self._folder.begin(self._scenario, self._manifest)
        if self._checkpoint_steps:
            (folder / checkpoint.FOLDER).mkdir(exist_ok=True)
            sync_folder(folder)

    def _write_tables(self) -> None:
        """Write the run's tables; unless the run can be resumed, delete its parts' tables and the checkpoints."""
        folder = self._folder.path
        assert self._outcome is not None
        can_go_on = self._can_go_on(folder)
        run_tables.write_tables(folder, self._outcome, keep_unmerged=can_go_on)
        if not can_go_on:
            shutil.rmtree(folder / checkpoint.FOLDER, ignore_errors=True)

    def _can_go_on(self, folder: Path) -> bool:
        assert self._outcome is not None
        return not self._outcome.is_complete and (folder / checkpoint.FOLDER / checkpoint.NEWEST).exists()

    @contextmanager
    def _recorder(self) -> Iterator[Sink | None]:
        """Yield the recorder if the scenario is recorded, else a sink for the viewer if there is one, else None.

        In a resumed run the recorder continues from the checkpoint.
        """
        folder, scenario = self._folder.path, self._scenario
        before = resume.make_ready(folder, self._resumed) if self._resumed else {}
        if scenario.record == "off":
            if self._viewer:
                (folder / LAYOUT).write_bytes(layout_json(scenario.arena.width_m, scenario.arena.height_m))
            yield ViewersOnly(scenario, self._viewer) if self._viewer else None
            return
        with Recorder(folder, scenario, wire=scenario.record == "wire", viewer=self._viewer) as recorder:
            if self._resumed:
                self._why += recorder.continue_from(before, self._resumed.step)
                for file in before.values():
                    file.unlink()
            yield recorder

    def _do_steps(self, recorder: Sink | None) -> None:
        """Do the steps until the end or a second signal; further signals come too late."""
        try:
            self._try_steps(recorder)
            self._stop.conclude()
        except KeyboardInterrupt:
            self._why.append(AT_ONCE)

    def _try_steps(self, recorder: Sink | None) -> None:
        """Do the steps, in real processes or in one, and let onlookers connect."""
        if self._options.in_process and recorder is None:  # onlookers would see nothing
            self._run_in_process(None)
            return
        with LiveSocket(self._folder.path, self._folder.target.name, self._scenario) as live:
            self._onlookers.append(live)
            if self._options.in_process and recorder is not None:
                self._run_in_process(Tap(recorder, self._onlookers))
            else:
                self._try_processes(recorder)

    def _run_in_process(self, sink: Sink | None) -> None:
        from deltaswarm_orchestrator.run.in_process import run_in_process  # imports numpy, which is slow

        self._outcome = run_in_process(self._scenario, sink, self._reporter, lambda: self._stop.by)
        self._why += self._outcome.messages

    def _try_processes(self, recorder: Sink | None) -> None:
        try:
            self._run_processes(recorder)
        except (LaunchError, ConnectionError) as error:
            disk.check_spare(self._folder.path)  # a part cannot log that the disk is full
            self._why.append(str(error))
        except StoppedError:
            pass

    def _run_processes(self, recorder: Sink | None) -> None:
        """Launch all processes, watch them, and end them.

        Raises:
            LaunchError, ConnectionError: a part did not start.
            StoppedError: the user asked to stop before all parts were up.
            RoomError: the recording could not be written.
        """
        scenario, folder, boards = self._scenario, self._folder.path, self._options.boards
        # With boards the name must not change, because a board's file is used for later runs too.
        # Without boards it is random; the router and its port serve this run alone.
        name = scenario.name if boards else f"{scenario.name}-{secrets.token_hex(4)}"
        who = boards.agents if boards else ()
        zenoh, wire, every = self._options.zenoh, scenario.record == "wire", self._checkpoint_steps
        station = self._options.station
        stopped, resumed = (lambda: self._stop.by), self._resumed
        with Swarm(scenario, name, folder, zenoh, who, stopped, every, resumed, station) as swarm:
            if station:
                url = swarm.start_station()
                self._reporter.say(f"station: {url}")
                announce(folder, url)
            if self._options.researcher and recorder is not None:
                page = Station()
                feed = ResearcherFeed(page.operators_end, name, scenario)
                self._onlookers.append(feed)
                url = swarm.start_station(page, 1)
                self._reporter.say(f"researcher's view, which shows the truth: {url}")
            swarm.start_world(
                folder / "scenario.toml",
                listen=self._options.listen,
                record=recorder is not None,
                wire=wire,
                for_boards=boards.listen if boards else "",
                tls=boards.tls if boards else None,
            )
            if boards:
                self._reporter.say(commands(boards.write(name, swarm.endpoints[-1], scenario, swarm.password)))
            first = self._resumed.step + 1 if self._resumed else 0
            link = swarm.recorder_link()
            with Observer(name, link, recorder, wire=wire, first_step=first, checkpoint_steps=every) as observer:
                patience_s = scenario.run.step_timeout_s
                watch = Watch(swarm, observer, self._reporter, self._stop, patience_s, self._onlookers)
                try:
                    swarm.start_operator(publish_all=recorder is not None)
                    swarm.start_agents()
                    swarm.write_pids()
                    watch.to_the_end()
                finally:
                    self._why += watch.why
                    tails = [(who, tail) for who, tail in watch.logs.items() if tail.strip()]
                    self._logs += [f"the last lines of the log of {who}:\n{tail}" for who, tail in tails]
                    self._operator_restarts = watch.operator_restarts
                    self._disk_is_full = watch.disk_is_full

    def _conclude(self) -> dict[str, Any]:
        """Return the summary, and update the manifest to agree with it."""
        if self._outcome is None:
            self._outcome = run_tables.read_outcome(self._folder.path)
        summary = run_tables.summary(self._outcome, self._scenario)
        by = self._stop.by
        reason = "finished" if summary["complete"] else f"{STOPPED_BY} {by}" if by else "failed"
        if not summary["complete"]:
            summary["invalid_because"][0] += f": {reason}"
        ending = {
            "exit_reason": reason,
            "why": self._why,
            "operator_restarts": self._operator_restarts,
            "resumed": self._manifest["resumed"],
        }
        self._manifest |= {**ending, "digest": summary["digest"], "complete": summary["complete"]}
        return {**summary, **ending}
