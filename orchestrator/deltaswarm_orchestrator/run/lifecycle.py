"""One run from scenario to summary, in real processes or in one process."""

import shutil
import sys
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import disk, inputs, limits, provenance, seal
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.disk import RoomError
from deltaswarm_orchestrator.base.exits import INTERRUPTED, OK, CommandError, Reporter, complain
from deltaswarm_orchestrator.base.inputs import InputsChangedError
from deltaswarm_orchestrator.base.signals import Stop, decide, stoppable
from deltaswarm_orchestrator.live.foxglove_server import FoxgloveServer
from deltaswarm_orchestrator.live.observers import Guarded, LiveObserver, Tap
from deltaswarm_orchestrator.live.rate_limit import ViewersOnly
from deltaswarm_orchestrator.live.views import LiveSocket
from deltaswarm_orchestrator.processes.elsewhere import PYTHON
from deltaswarm_orchestrator.processes.process import RunPart
from deltaswarm_orchestrator.processes.starter import StoppedError
from deltaswarm_orchestrator.recording import LAYOUT
from deltaswarm_orchestrator.recording.recorder import Recorder, layout_json
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.results import resume, run_tables
from deltaswarm_orchestrator.results.folder import ResumedFolder, RunFolder
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.run_tables import score_answers, write_scored
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.by_processes import run_by_processes
from deltaswarm_orchestrator.run.ending import Reason
from deltaswarm_orchestrator.run.engine import Wanted
from deltaswarm_orchestrator.run.options import STOPPED_BY, RunContext, RunOptions, RunResult, check
from deltaswarm_orchestrator.run.watch import CONDUCTOR
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import NOBODY_LEFT
from deltaswarm_wire import checkpoint
from deltaswarm_wire.files import sync_folder
from deltaswarm_wire.foreign import called, name_of
from deltaswarm_wire.plugin_errors import PluginError, blamed, described, is_interrupt, own_traceback
from deltaswarm_wire.plugins import OBSERVERS, find

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
        InputsChangedError: this process has loaded a module that has changed since.
        CommandError: the user asked to stop twice before the run began.
    """
    check(scenario, options)
    with stoppable() as stop:
        try:
            with disk.room_in(options.out), ExitStack() as stack:
                return _Run(_prepare(scenario, options, reporter, stop, stack)).execute()
        except KeyboardInterrupt as error:
            if not is_interrupt(error):
                raise
            raise CommandError(f"{STOPPED_BY} {stop.by}", INTERRUPTED) from None


def _prepare(scenario: Scenario, options: RunOptions, reporter: Reporter, stop: Stop, stack: ExitStack) -> RunContext:
    """Take all that a run needs; the stack releases it."""
    placement, viewer, observers = None, None, list[LiveObserver]()
    if options.engine:
        placement = stack.enter_context(options.engine.placed(scenario.agents.count, reporter.say))
    if options.live_port is not None:
        viewer = stack.enter_context(FoxgloveServer(scenario.name, options.live_port, reporter.say))
        observers.append(viewer)
        reporter.say(f"live: open {viewer.url} in Foxglove; it shows the truth, which the operator does not know")
    if options.observer:
        kind = find(OBSERVERS, options.observer, "--live")
        named = called(name_of(kind), kind, options.live_connect, scenario, passes=(CommandError,))
        shows = called(f"{name_of(kind)}.shows", getattr, named, "shows", at=kind)
        observers.append(stack.enter_context(Guarded(named, complain)))
        reporter.say(f"live: {shows}")
    decisive = options.inputs or inputs.identify(scenario)
    inputs.check(scenario, decisive, starts_python=not options.in_process)
    if placement:
        placement.check_controller(scenario.control.mode)
    if options.boards:
        options.boards.prepare(scenario)
    resumed = None
    if options.resume:
        resume.check_inputs(options.out, scenario)  # before the folder is touched
        folder: RunFolder = stack.enter_context(ResumedFolder(options.out, force=options.force))
        resume.wait_for_leftovers(folder.path)
        resumed = resume.newest(folder.path)
    else:
        folder = stack.enter_context(RunFolder(options.out, force=options.force))
    return RunContext(scenario, options, reporter, stop, folder, decisive, placement, viewer, observers, resumed)


class _Run:
    def __init__(self, context: RunContext) -> None:
        self.context, self.ending, self.folder = context, context.ending, context.folder
        self.scenario, self.options, self.stop = context.scenario, context.options, context.stop
        self.outcome: Outcome | None = None
        if context.resumed:
            step = context.resumed.step
            self.manifest = seal.read_sealed(self.folder.path / seal.MANIFEST)
            for name in ("why", "complete"):  # of an earlier end, beyond which this run goes
                self.manifest.pop(name, None)
            self.manifest |= {"exit_reason": run_tables.RUNNING, "digest": None, "events_digest": None}
            if step != self.manifest.get(resume.BRANCH, {}).get(resume.AFTER_STEP):
                self.manifest["resumed"] = [*self.manifest["resumed"], {"at": provenance.now(), "step": step}]
        else:
            engine = "in-process" if self.options.in_process else "dask" if context.placement else "processes"
            self.manifest = run_tables.new_manifest(self.scenario, engine, self.scenario.record, context.inputs)
            self.manifest |= {"workers": context.placement.workers} if context.placement else {}
            self.manifest |= {"checkpoint_steps": self.options.checkpoint_steps, "resumed": []}
        context.checkpoint_steps = self.manifest["checkpoint_steps"]

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
                        self.ending.why.append(AT_ONCE)
                    summary = self._conclude()
                    if isinstance(recorder, Recorder):
                        recorder.complete(self.manifest, run_tables.person_tables(folder))
                self._write_tables()
        except (Exception, KeyboardInterrupt) as error:  # whatever cannot be completed, what is known is written
            self.stop.conclude()
            if isinstance(error, OSError):  # such as a folder that is gone
                error = disk.no_room(error, folder)
            if isinstance(error, RoomError):
                reason = str(error)
            elif isinstance(error, KeyboardInterrupt):
                reason = AT_ONCE
            else:
                reason = self._note_error(error, "the run could not be concluded")
            if not (self.ending.disk_is_full and isinstance(error, RoomError)):
                self.ending.fail(reason)
            summary = self._conclude()
            if summary["complete"]:
                summary |= {"valid": False, "invalid_because": [*summary["invalid_because"], reason]}
        path = self._finish(summary)
        resume = command_line("run", "--resume", path, *self.options.kept)
        hint = [f"to go on from the last checkpoint: {resume}"] if self._can_go_on(path) else []
        messages = (*summary["why"], *self.ending.messages, *hint)
        result = RunResult(path, summary, str(self.manifest["exit_reason"]), messages)
        decide(result.code, self.stop if result.code == OK else None)
        return result

    def _finish(self, summary: dict[str, Any]) -> Path:
        """Write manifest and summary, and give the folder its final name; return its path."""
        folder = self.folder.path
        try:
            disk.give_up_reserve(folder)  # not earlier: recording and tables could use it up
            self.folder.conclude(self.manifest, summary)
        except OSError as error:
            lost = disk.no_room(error, folder)
            raise RoomError("; ".join([*summary["why"][:1], str(lost)])) from None
        return self.folder.finish()

    def _note_error(self, error: BaseException, what: str) -> str:
        if plugin := blamed(error):
            self.ending.texts += filter(None, [plugin.trace])
            return str(plugin)
        self.ending.texts.append("".join(traceback.format_exception(error)).rstrip())
        return f"{what}: {described(error)}"

    def _prepare_folder(self) -> None:
        folder = self.folder.path
        if warning := disk.shortage(folder, self.scenario):
            self.context.reporter.say(f"warning: {warning}")
        if self.context.resumed:
            self.folder.prepare_to_resume(self.manifest)
        else:
            self.folder.prepare(self.scenario, self.manifest)
        if self.context.checkpoint_steps:
            (folder / checkpoint.FOLDER).mkdir(exist_ok=True)
            sync_folder(folder)

    def _write_tables(self) -> None:
        """Write the run's tables; unless the run can be resumed, delete its parts' tables and the checkpoints."""
        folder = self.folder.path
        assert self.outcome is not None
        can_go_on = self._can_go_on(folder)
        run_tables.write_tables(folder, self.outcome, keep_unmerged=can_go_on)
        write_scored(folder, self.outcome, self.scenario)
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
        folder, scenario, viewer, resumed = self.folder.path, self.scenario, self.context.viewer, self.context.resumed
        before = resume.make_ready(folder, resumed) if resumed else {}
        if scenario.record == "off":
            if viewer:
                (folder / LAYOUT).write_bytes(layout_json(scenario.arena.width_m, scenario.arena.height_m))
            yield ViewersOnly(scenario, viewer) if viewer else None
            return
        with Recorder(folder, scenario, wire=scenario.record == "wire", viewer=viewer) as recorder:
            if resumed:
                self.ending.why += recorder.continue_from(before, resumed.step)
                for file in before.values():
                    file.unlink()
            yield recorder

    def _do_steps(self, recorder: Sink | None) -> None:
        """Do the steps, in real processes or in one, and note why they ended too early."""
        try:
            self._step_to_the_end(recorder)
        except StoppedError:
            pass
        except (RoomError, KeyboardInterrupt):
            raise
        except BaseException as error:  # Zenoh's threads fail by a panic, which is no Exception
            if isinstance(error, OSError) and disk.is_refused(error):
                raise
            if limit := limits.reached(error):
                self.ending.fail(f"the run cannot go on: {limit}")
            else:
                where = "the run failed" if self.options.in_process else f"the orchestrator failed {self.ending.when}"
                self.ending.fail(self._note_error(error, where))

    def _step_to_the_end(self, recorder: Sink | None) -> None:
        """Do the steps, and let observers connect, who would see nothing of a run in one process without recorder."""
        if self.options.in_process and recorder is None:
            self._run_in_process(None)
            return
        observers = self.context.observers
        with LiveSocket(self.folder.path, self.folder.target.name, self.scenario) as live:
            observers.append(live)
            if self.options.in_process and recorder is not None:
                self._run_in_process(Tap(recorder, observers))
            else:
                run_by_processes(self.context, recorder)

    def _run_in_process(self, sink: Sink | None) -> None:
        from deltaswarm_orchestrator.run.choosing import run_here  # imports numpy, which is slow
        from deltaswarm_orchestrator.run.state import RunState

        debugger, seat = _Debugger(), self.options.seat
        wanted = Wanted(
            sink,
            self.folder.path,
            self.context.reporter,
            lambda: self.stop.by or debugger.was_left,
            debugger if self.options.debug else lambda error: None,
            seat=seat,
        )
        state = RunState.read(self.folder.path, self.context.resumed) if self.context.resumed else None
        asked = PYTHON if self.options.debug or seat else self.options.in_process_engine
        self.outcome, by = run_here(self.scenario, wanted, state, asked=asked)
        if seat and seat.was_ended:
            self.stop.by = self.stop.by or CONDUCTOR
        self.manifest["in_process"] = by.told
        self.ending.why += self.outcome.messages
        if not self.stop.by:
            self.ending.cause = next(iter(self.outcome.messages), None)
        self.ending.traces |= self.outcome.traces

    def _conclude(self) -> dict[str, Any]:
        """Return the summary, and update the manifest to agree with it."""
        try:
            if self.outcome is None:
                self.outcome = run_tables.read_outcome(self.folder.path)
            self._note_causes(self.outcome)
            summary = summarise(self.outcome, self.scenario)
            summary |= score_answers(self.folder.path, self.outcome, self.scenario)
        except Exception as error:  # a table that is damaged or gone
            self.ending.fail(self._note_error(error, "the tables cannot be summarised"))
            self.outcome = Outcome()
            summary = summarise(self.outcome, self.scenario)
        by, why = self.stop.by, self._whys(self.outcome, {row["agent"] for row in summary["agents_hung"]})
        reason = "finished" if summary["complete"] else f"{STOPPED_BY} {by}" if by else "failed"
        try:
            inputs.check(self.scenario, self.context.inputs, starts_python=not self.options.in_process)
        except InputsChangedError as error:
            summary |= {"valid": False, "invalid_because": [*summary["invalid_because"], str(error)]}
        if not summary["complete"]:
            cause = self.ending.cause
            line = reason if cause is None else self._line(cause, self.outcome).removeprefix(f"{NOBODY_LEFT}: ")
            summary["invalid_because"][0] += f": {line}"
        ending = {
            "exit_reason": reason,
            "why": why,
            "operator_restarts": self.ending.operator_restarts,
            "resumed": self.manifest["resumed"],
        }
        self.manifest |= {**ending, **{name: summary[name] for name in ("digest", "events_digest", "complete")}}
        return {**summary, **ending}

    def _note_causes(self, outcome: Outcome) -> None:
        """Note why the processes of agents ended that the world lost, or that failed before the first step."""
        lost = {row["agent"] for row in outcome.world.get("agents_failed", ())}
        for part in self.ending.agents:
            if part.was_ended_here:
                outcome.outlasted[part.number] = part.outlasted
            is_early = not outcome.step_records and part.has_failed
            if is_early or (part.number in lost and part.exit_code is not None):
                cause = part.how_it_ended().removeprefix(f"{part.name} ").removeprefix("was ")
                outcome.causes[part.number] = cause.removeprefix(f"ended with exit code {part.exit_code}: ")

    def _whys(self, outcome: Outcome, hung: set[int]) -> list[str]:
        """Return the lines of `why`; agents that ended early, though well by their exit code, or hung, get one too."""
        told = {entry.number for entry in self.ending.why if isinstance(entry, RunPart)}
        lost = _steps_lost(outcome).keys() - told
        quiet = [
            part
            for part in self.ending.agents
            if (part.exit_code == 0 and part.number in lost) or (part.was_ended_here and part.number in lost | hung)
        ]
        return [self._line(entry, outcome) for entry in [*self.ending.why, *quiet]]

    def _line(self, entry: Reason, outcome: Outcome) -> str:
        """Return an entry of `why` as a line; an agent's has the step in which the world lost it."""
        if isinstance(entry, str):
            return entry
        step = _steps_lost(outcome).get(entry.number)
        return entry.how_it_ended(entry.seen if step is None else f"in step {step}")


class _Debugger:
    """Stops in Python's debugger where a plug-in first raised; the run ends when the user leaves it (`--debug`)."""

    def __init__(self) -> None:
        self.was_left = False

    def __call__(self, error: PluginError) -> None:
        raised = error.__cause__
        if self.was_left or raised is None:
            return
        print(f"{error.report}\nThe run ends when you leave the debugger (q).", file=sys.stderr)
        import pdb  # slow, and needed only here

        try:
            pdb.post_mortem(own_traceback(raised))
        finally:
            self.was_left = True


def _steps_lost(outcome: Outcome) -> dict[int, int]:
    """Return the agents that the world has lost, with the step of each; of one that hung first, that of this."""
    lost = dict(zip(outcome.world.get("agents_lost", ()), outcome.world.get("lost_in_step", ()), strict=True))
    late = {row["agent"]: row["step"] for row in outcome.world.get("agents_late", ())}
    return lost | {agent: late[agent] for agent in outcome.outlasted if agent in late}
