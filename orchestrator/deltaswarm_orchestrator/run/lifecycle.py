"""One run from scenario to summary, in real processes or in one process."""

import json
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import disk, limits, provenance
from deltaswarm_orchestrator.base.disk import RoomError
from deltaswarm_orchestrator.base.exits import INTERRUPTED, OK, CommandError
from deltaswarm_orchestrator.base.signals import Stop, decide, stoppable
from deltaswarm_orchestrator.live.foxglove_server import FoxgloveServer
from deltaswarm_orchestrator.live.observers import LiveObserver, Tap
from deltaswarm_orchestrator.live.rate_limit import ViewersOnly
from deltaswarm_orchestrator.live.views import LiveSocket, ResearcherFeed
from deltaswarm_orchestrator.processes.boards import commands
from deltaswarm_orchestrator.processes.elsewhere import Placement
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.processes.process import RunPart
from deltaswarm_orchestrator.processes.starter import LaunchError, StoppedError
from deltaswarm_orchestrator.processes.station import Station, announce
from deltaswarm_orchestrator.recording.layout import LAYOUT, layout_json
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.results import resume, run_tables
from deltaswarm_orchestrator.results.folder import ResumedFolder, RunFolder
from deltaswarm_orchestrator.results.judgements import task_score, write_judgements
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.results.situation import write_situation
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.options import STOPPED_BY, RunOptions, RunResult, check
from deltaswarm_orchestrator.run.reporter import Reporter
from deltaswarm_orchestrator.run.shown import foxglove_viewer, named_observer
from deltaswarm_orchestrator.run.watch import Watch
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checkpoint
from deltaswarm_wire.files import sync_folder

AT_ONCE = "a second signal ended the run at once"


def run(scenario: Scenario, options: RunOptions, reporter: Reporter) -> RunResult:
    """Do one run and write its folder.

    Raises:
        FolderError: the folder cannot be taken, or has no checkpoint to resume from.
        FolderTakenError: the folder could not be given its final name.
        SettingsError: the scenario cannot be run with these boards, or has a bound that processes cannot compute.
        LiveError: the run cannot be shown live.
        RoomError: the disk is too full to write how the run ended.
        ClusterError: the cluster cannot do this run.
        CommandError: the user asked to stop twice before the run began.
    """
    check(scenario, options)
    with stoppable() as stop:
        try:
            with (
                disk.room_in(options.out),
                _placed(scenario, options, reporter) as placement,
                foxglove_viewer(scenario, options, reporter) as viewer,
                named_observer(scenario, options, reporter) as observer,
            ):
                return _run(scenario, options, reporter, stop, viewer, observer, placement)
        except KeyboardInterrupt:
            raise CommandError(f"{STOPPED_BY} {stop.by}", INTERRUPTED) from None


def _placed(scenario: Scenario, options: RunOptions, reporter: Reporter) -> AbstractContextManager[Placement | None]:
    """Yield the places of agents on other machines; None if they run here."""
    return options.engine.placed(scenario.agents.count, reporter.say) if options.engine else nullcontext()


def _run(
    scenario: Scenario,
    options: RunOptions,
    reporter: Reporter,
    stop: Stop,
    viewer: FoxgloveServer | None,
    named: LiveObserver | None,
    placement: Placement | None,
) -> RunResult:
    if options.boards:
        options.boards.prepare(scenario)
    if options.resume:
        resume.check_inputs(options.out, scenario)  # before the folder is touched
        with ResumedFolder(options.out) as folder:
            resume.wait_for_leftovers(folder.path)
            newest = resume.newest(folder.path)
            return _Run(scenario, options, folder, reporter, stop, viewer, named, newest).execute()
    with RunFolder(options.out, force=options.force) as folder:
        return _Run(scenario, options, folder, reporter, stop, viewer, named, placement=placement).execute()


@dataclass(eq=False)
class _Run:
    """One run and its outcome."""

    scenario: Scenario
    options: RunOptions
    folder: RunFolder
    reporter: Reporter
    stop: Stop
    viewer: FoxgloveServer | None
    named: LiveObserver | None
    resumed: Resumed | None = None
    placement: Placement | None = None
    outcome: Outcome | None = None
    why: list[str | RunPart] = field(default_factory=list)
    """Reasons why the run ended too early, and what was lost, one line each; an agent stands for its own line."""
    agents: Sequence[RunPart] = ()
    """The processes of agents, which have ended when the run is concluded."""
    logs: list[str] = field(default_factory=list)
    """The last lines of the logs of failed parts."""
    operator_restarts: int = 0
    disk_is_full: bool = False

    def __post_init__(self) -> None:
        self.live_observers: list[LiveObserver] = [shown for shown in (self.viewer, self.named) if shown]
        if self.resumed:
            self.manifest = json.loads((self.folder.path / "manifest.json").read_text(encoding="utf-8"))
            self.manifest |= {"exit_reason": run_tables.RUNNING}
            self.manifest["resumed"] = [*self.manifest["resumed"], {"at": provenance.now(), "step": self.resumed.step}]
        else:
            engine = "in-process" if self.options.in_process else "dask" if self.placement else "processes"
            self.manifest = run_tables.new_manifest(self.scenario, engine, self.scenario.record)
            self.manifest |= {"workers": self.placement.workers} if self.placement else {}
            self.manifest |= {"checkpoint_steps": self.options.checkpoint_steps, "resumed": []}
        self.checkpoint_steps: int = self.manifest["checkpoint_steps"]

    def execute(self) -> RunResult:
        """Do all steps, then write tables, summary and manifest.

        A signal after the last step comes too late to change the recorded outcome.
        """
        folder = self.folder.path
        summary: dict[str, Any] = {}
        try:
            with disk.room_in(folder):
                self._prepare_folder()
                with self._recorder() as recorder:
                    try:
                        self._do_steps(recorder)
                        self.stop.conclude()  # further signals come too late
                    except KeyboardInterrupt:
                        self.why.append(AT_ONCE)
                    summary = self._conclude()
                    if isinstance(recorder, Recorder):
                        recorder.complete(self.manifest, run_tables.person_tables(folder))
                self._write_tables()
        except (RoomError, KeyboardInterrupt) as error:
            self.stop.conclude()
            if not (self.disk_is_full and isinstance(error, RoomError)):
                self.why.append(str(error) or AT_ONCE)
            summary = self._conclude()
            if summary["complete"]:
                summary |= {"valid": False, "invalid_because": [*summary["invalid_because"], str(error)]}
        finally:
            disk.give_up_reserve(folder)  # not earlier: recording and tables could use it up
        self.folder.write_manifest(self.manifest)  # first: without it nobody knows how the run ended
        run_tables.write_json(folder / "summary.json", summary)
        path = self.folder.finish()
        hint = [f"to go on from the last checkpoint: deltaswarm run --resume {path}"] if self._can_go_on(path) else []
        messages = (*summary["why"], *self.logs, *hint)
        result = RunResult(path, summary, str(self.manifest["exit_reason"]), messages)
        decide(result.code, self.stop if result.code == OK else None)
        return result

    def _prepare_folder(self) -> None:
        """Prepare the folder for the first step."""
        folder = self.folder.path
        if warning := disk.shortage(folder, self.scenario):
            self.reporter.say(f"warning: {warning}")
        if self.resumed:
            self.folder.prepare_to_resume(self.manifest)
        else:
            self.folder.prepare(self.scenario, self.manifest)
        if self.checkpoint_steps:
            (folder / checkpoint.FOLDER).mkdir(exist_ok=True)
            sync_folder(folder)

    def _write_tables(self) -> None:
        """Write the run's tables; unless the run can be resumed, delete its parts' tables and the checkpoints."""
        folder = self.folder.path
        assert self.outcome is not None
        can_go_on = self._can_go_on(folder)
        run_tables.write_tables(folder, self.outcome, keep_unmerged=can_go_on)
        write_situation(folder, self.outcome, self.scenario)
        write_judgements(folder, self.outcome)
        if not can_go_on:
            shutil.rmtree(folder / checkpoint.FOLDER, ignore_errors=True)

    def _can_go_on(self, folder: Path) -> bool:
        assert self.outcome is not None
        return not self.outcome.is_complete and (folder / checkpoint.FOLDER / checkpoint.NEWEST).exists()

    @contextmanager
    def _recorder(self) -> Iterator[Sink | None]:
        """Yield the recorder if the scenario is recorded, else a sink for the viewer if there is one, else None.

        In a resumed run the recorder continues from the checkpoint.
        """
        folder, scenario = self.folder.path, self.scenario
        before = resume.make_ready(folder, self.resumed) if self.resumed else {}
        if scenario.record == "off":
            if self.viewer:
                (folder / LAYOUT).write_bytes(layout_json(scenario.arena.width_m, scenario.arena.height_m))
            yield ViewersOnly(scenario, self.viewer) if self.viewer else None
            return
        with Recorder(folder, scenario, wire=scenario.record == "wire", viewer=self.viewer) as recorder:
            if self.resumed:
                self.why += recorder.continue_from(before, self.resumed.step)
                for file in before.values():
                    file.unlink()
            yield recorder

    def _do_steps(self, recorder: Sink | None) -> None:
        """Do the steps, in real processes or in one, and let observers connect."""
        if self.options.in_process and recorder is None:  # observers would see nothing
            self._run_in_process(None)
            return
        with LiveSocket(self.folder.path, self.folder.target.name, self.scenario) as live:
            self.live_observers.append(live)
            if self.options.in_process and recorder is not None:
                self._run_in_process(Tap(recorder, self.live_observers))
                return
            try:
                self._run_processes(recorder)
            except (LaunchError, ConnectionError) as error:
                disk.check_spare(self.folder.path)  # a part cannot log that the disk is full
                self.why.append(str(error))
            except StoppedError:
                pass
            except BaseException as error:  # Zenoh's threads fail by a panic, which is no Exception
                if (limit := limits.reached(error)) is None:
                    raise
                self.why.append(f"the run cannot go on: {limit}")

    def _run_in_process(self, sink: Sink | None) -> None:
        from deltaswarm_orchestrator.run.in_process import run_in_process  # imports numpy, which is slow

        self.outcome = run_in_process(self.scenario, sink, self.reporter, lambda: self.stop.by, self.folder.path)
        self.why += self.outcome.messages

    def _run_processes(self, recorder: Sink | None) -> None:
        """Launch all processes, watch them, and end them.

        Raises:
            LaunchError, ConnectionError: a part did not start.
            StoppedError: the user asked to stop before all parts were up.
            RoomError: the recording could not be written.
        """
        scenario, folder, options, resumed = self.scenario, self.folder.path, self.options, self.resumed
        boards, station = options.boards, options.station
        # With boards the name must not change, because a board's file is used for later runs too.
        # Without boards it is random; the router and its port serve this run alone.
        name = scenario.name if boards else f"{scenario.name}-{secrets.token_hex(4)}"
        with Swarm(
            scenario,
            name,
            folder,
            zenoh=options.zenoh,
            boards=boards,
            remote=self.placement.agents(scenario, folder / "logs") if self.placement else None,
            was_stopped=lambda: self.stop.by,
            checkpoint_steps=self.checkpoint_steps,
            resumed=resumed,
            station=station,
        ) as swarm:
            self._start_pages(swarm, has_truth=recorder is not None)
            swarm.start_world(options.listen, record=recorder is not None)
            if boards:
                self.reporter.say(commands(boards.write(name, swarm.endpoints[-1], scenario, swarm.password)))
            with Observer(
                name,
                swarm.recorder_link(),
                recorder,
                wire=scenario.record == "wire",
                first_step=resumed.step + 1 if resumed else 0,
                checkpoint_steps=self.checkpoint_steps,
            ) as observer:
                patience_s = scenario.run.step_timeout_s
                watch = Watch(swarm, observer, self.reporter, self.stop, patience_s, self.live_observers)
                try:
                    swarm.start_operator(publish_all=recorder is not None)
                    swarm.start_agents()
                    swarm.write_pids()
                    watch.watch_to_the_end()
                finally:
                    self.why += watch.why
                    self.agents = swarm.agents
                    self.logs += [
                        f"the last lines of the log of {part}:\n{tail}"
                        for part, tail in watch.logs.items()
                        if tail.strip()
                    ]
                    self.operator_restarts = watch.operator_restarts
                    self.disk_is_full = watch.disk_is_full

    def _start_pages(self, swarm: Swarm, *, has_truth: bool) -> None:
        """Start the pages of the person and of the researcher, if the run has them, and say where they are.

        Raises:
            LaunchError, StoppedError: as in `_run_processes`.
        """
        station, urls = self.options.station, {}
        if station:
            urls = {"url": swarm.start_station(), "watch_url": station.watch_url}
            self.reporter.say(f"station: {urls['url']}")
            self.reporter.say(f"only to watch it: {station.watch_url}")
        if self.options.researcher and has_truth:
            page = Station()
            feed = ResearcherFeed(page.operators_end, swarm.run, self.scenario, is_beside_operator=station is not None)
            self.live_observers.append(feed)
            urls["researcher_url"] = swarm.start_station(page, 1)
            swarm.conductor = page if station else None
            self.reporter.say(f"conductor's page, which shows the truth: {urls['researcher_url']}")
        if station:
            announce(self.folder.path, urls, opens_browser=station.opens_browser)

    def _conclude(self) -> dict[str, Any]:
        """Return the summary, and update the manifest to agree with it."""
        if self.outcome is None:
            self.outcome = run_tables.read_outcome(self.folder.path)
        summary = summarise(self.outcome, self.scenario) | task_score(self.folder.path, self.outcome)
        by = self.stop.by
        reason = "finished" if summary["complete"] else f"{STOPPED_BY} {by}" if by else "failed"
        if not summary["complete"]:
            summary["invalid_because"][0] += f": {reason}"
        ending = {
            "exit_reason": reason,
            "why": self._whys(self.outcome),
            "operator_restarts": self.operator_restarts,
            "resumed": self.manifest["resumed"],
        }
        self.manifest |= {**ending, "digest": summary["digest"], "complete": summary["complete"]}
        return {**summary, **ending}

    def _whys(self, outcome: Outcome) -> list[str]:
        """Return the lines of `why`; agents that ended early, though well by their exit code, get one too."""
        world = outcome.world
        lost = dict(zip(world.get("agents_lost", ()), world.get("lost_in_step", ()), strict=True))
        told = {entry.number for entry in self.why if isinstance(entry, RunPart)}
        quiet = [part for part in self.agents if part.exit_code == 0 and part.number in lost.keys() - told]
        when = {agent: f"in step {step}" for agent, step in lost.items()}
        return [
            entry if isinstance(entry, str) else entry.how_it_ended(when.get(entry.number, ""))
            for entry in [*self.why, *quiet]
        ]
