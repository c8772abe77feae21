"""Carry out the steps of a session: do runs, and ask for missing answers. Where its pages are, subclasses know."""

from dataclasses import dataclass, field
from pathlib import Path

from deltaswarm.runs import check as check_run
from deltaswarm_cli import report
from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import FAILED, OK, complain, notice
from deltaswarm_orchestrator.base.inputs import Inputs, identify
from deltaswarm_orchestrator.base.paths import free_folder
from deltaswarm_orchestrator.base.signals import heed_signals_again
from deltaswarm_orchestrator.results.folder_lock import FolderLock
from deltaswarm_orchestrator.run.operating import question_warning
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_sessions.folder import (
    RECORD,
    attempts_at,
    check_design,
    locked,
    scenario_of,
    write_record,
)
from deltaswarm_sessions.plan import PlannedRun, order_warning
from deltaswarm_sessions.session import Ask, DoRun, Session


@dataclass(kw_only=True)
class Runner:
    """Does the session of one participant in a folder of its own."""

    session: Session
    folder: Path
    speed: float
    """Simulated per wall second to begin with; 0: as fast as possible."""
    in_process: bool = True
    """Whether the agents are in one process with all else."""
    quiet: bool = False
    command: str = ""
    """The command that continues the session, for the experimenter."""
    _lock: FolderLock = field(init=False)
    """Held while the session is done, and by the process that asks."""
    _inputs: dict[str, Inputs] = field(init=False)
    """The files that decide each run, as they were when the session was planned."""

    def __post_init__(self) -> None:
        self._inputs = {run.folder: identify(run.scenario) for run in self.session.runs}

    def check(self) -> list[str]:
        """Make every check of all runs, before a participant has done the first; return warnings."""
        for run in self.session.runs:
            check_run(run.scenario, self._options(run))
        plans = [question_warning(run.scenario, self.speed) for run in self.session.runs]
        return [*dict.fromkeys(warning for warning in [*plans, order_warning(self.session.runs)] if warning)]

    def begin(self) -> None:
        """Take the folder, and write the record of what is done and planned."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = locked(self.folder)
        try:
            self._put_aside()
            self._read()
            check_design(self.folder, self.session)
            write_record(self.folder, self.session)
        except BaseException:
            self._lock.release()
            raise

    def _put_aside(self) -> None:
        """Put aside what is no attempt, before attempts are read."""

    def run(self) -> int:
        """Do what is left of the session that was begun, and keep its record; return the exit code."""
        try:
            return self._do_steps()
        finally:
            self._lock.release()

    def _do_steps(self) -> int:
        for step in self.session.steps():
            if isinstance(step, DoRun):
                notice(step.text)
                if code := self._do_run(step.run):
                    complain(f"the session stops here; to go on: {self.command}")
                    return code
            elif isinstance(step, Ask):
                if step.text:
                    notice(step.text)
                self._ask(step)
            else:
                complain(step.text)
                if step.is_end:
                    return FAILED
            self._note()
        return OK

    def _note(self) -> None:
        self._read()
        write_record(self.folder, self.session)

    def _read(self) -> None:
        seal.checked(self.folder / RECORD)  # before a new record seals what it finds
        for run in self.session.runs:
            self.session.attempts[run.folder] = attempts_at(self.folder, run)

    def _options(self, run: PlannedRun) -> RunOptions:
        out = free_folder(self.folder / run.folder)
        return RunOptions(out=out, in_process=self.in_process, inputs=self._inputs[run.folder])

    def _ready(self, run: PlannedRun) -> RunOptions:
        """Return how to do a run that begins now."""
        return self._options(run)

    def _do_run(self, run: PlannedRun) -> int:
        options = self._ready(run)
        scenario = scenario_of(run, options.out.name, self.session.attempts[run.folder])
        code = report.run_and_report(scenario, options, quiet=self.quiet)
        self._note()
        heed_signals_again()
        return code

    def _ask(self, step: Ask) -> None:
        """Ask until all is answered, or the time is over."""
        raise NotImplementedError
