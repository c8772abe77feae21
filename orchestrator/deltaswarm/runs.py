"""One run: done from Python or by the command line, and read back from its folder as data frames."""

import json
import os
import tomllib
import warnings
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltaswarm.arguments import SEEDS, public
from deltaswarm.errors import Error, in_python, one_error
from deltaswarm.keys import check_importable, scenario_of
from deltaswarm_orchestrator.base.exits import FAILED, Reporter
from deltaswarm_orchestrator.base.paths import must_exist, part_of
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.processes.elsewhere import engine_of
from deltaswarm_orchestrator.scenarios import DEFAULT_SCENARIO
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.checked import MAX_NUMBER, did_you_mean

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from deltaswarm_orchestrator.export.snapshots import Film
    from deltaswarm_orchestrator.results.outcome import Outcome
    from deltaswarm_orchestrator.run.options import RunOptions, RunResult

IN_PROCESS, PROCESSES = "in-process", "processes"


@public(seed=SEEDS)
def run(
    scenario: str | os.PathLike[str] = DEFAULT_SCENARIO,
    keys: Mapping[Any, Any] | None = None,
    *,
    seed: int | None = None,
    engine: str = IN_PROCESS,
    scheduler: str | None = None,
    commands: str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    progress: bool = True,
) -> "Run":
    """Do one run, as `deltaswarm run` does it: the same scenario and seed have the same digest.

    Ctrl-C ends it in order and returns what there is. A controller that raises ends its own agent, and the run goes on
    without it. In both cases a warning says why the run is not valid.

    Args:
        scenario: a built-in scenario (`deltaswarm list`) or a TOML file.
        keys: scenario keys by dotted names, such as `{"control.mode": "hybrid", "record": "off"}` (docs/SCENARIO.md). A
            class, such as a controller, stands for its `module:Class`. `events.density` may be a function of x and y
            [m], which is kept as a grid beside the run's folder.
        seed: of all randomness; None: the scenario's.
        engine: "in-process", "processes" on this machine, or an engine such as "dask".
        scheduler: with an engine: the address of its scheduler.
        commands: a file with the commands of a scripted operator.
        out: the folder to keep; None: a temporary one, which is deleted with the returned object.
        force: replace the folder if it exists.
        progress: show a bar on a terminal or in a notebook; elsewhere a line on standard error every 10 s.

    Raises:
        Error: the scenario has mistakes, the folder exists, the parts cannot start, or no step was done.
    """
    with one_error("deltaswarm.run"):
        from deltaswarm_orchestrator.results.folder import check_target
        from deltaswarm_orchestrator.run.options import RunOptions

        temporary = TemporaryFolder() if out is None else None
        folder = Path(out or "") if temporary is None else temporary.path / "run"
        file = None if commands is None else Path(commands)
        check_target(folder, force)  # before a file is written that the run there may have been done with
        density = folder.parent / f"{folder.name}-density.npy"
        loaded, given = scenario_of(os.fspath(scenario), keys or {}, seed, file, density)
        if engine != IN_PROCESS:
            check_importable(given, f"engine is {engine!r}; {IN_PROCESS!r} takes it as it is")
        placed = engine_of(engine, scheduler, path="engine", local=(IN_PROCESS, PROCESSES))
        options = RunOptions(out=folder, in_process=engine == IN_PROCESS, force=force, engine=placed)
        check(loaded, options)
        result = conduct(loaded, options, quiet=not progress)
        done = Run(result.folder, result.summary, temporary)
        if not result.summary["steps"]:
            raise Error(*result.messages, code=FAILED)
    if reasons := result.summary["invalid_because"]:
        told = [message for message in result.messages if not any(message in reason for reason in reasons)]
        warnings.warn(in_python("\n".join([f"not valid: {reason}" for reason in reasons] + told)), stacklevel=3)
    return done


@public()
def open(folder: str | os.PathLike[str]) -> "Run":
    """Open the folder of a run, whether it is complete, was interrupted, or is under way.

    Raises:
        Error: there is no such folder, it is not a run's, or one of its files is not as the run wrote it.
    """
    with one_error("deltaswarm.open"):
        from deltaswarm_orchestrator.inspect.info import describe

        path = Path(folder)
        must_exist(path, "folder", "the folder of a run", or_part=True)
        path = path if path.exists() else part_of(path)
        return Run(path, describe(path)["summary"])


def check(scenario: Scenario, options: "RunOptions") -> None:
    """Make every check of a run before anything is started or written.

    Raises:
        SettingsError, CommandError: the run would be refused.
    """
    from deltaswarm_orchestrator.doctor import check_parts_can_start
    from deltaswarm_orchestrator.run import options as checks

    if options.engine:
        check_parts_can_start(0, linked=scenario.agents.count)
    elif not options.in_process:
        check_parts_can_start(scenario.agents.count - len(options.boards.agents if options.boards else ()))
    checks.check(scenario, options)


def conduct(scenario: Scenario, options: "RunOptions", *, quiet: bool) -> "RunResult":
    """Do a checked run, and show its progress.

    Raises:
        SettingsError, CommandError: as `lifecycle.run`.
    """
    from deltaswarm_orchestrator.run.lifecycle import run as run_scenario

    with display_of(scenario, quiet=quiet) as display:
        return run_scenario(scenario, options, display)


def display_of(scenario: Scenario, *, quiet: bool) -> AbstractContextManager[Reporter]:
    """Return what shows the progress of a run."""
    from deltaswarm_orchestrator.run.progress import Display

    return nullcontext(Reporter()) if quiet else Display(scenario.run.step_s, scenario.agents.count)


class Run:
    """One run. Tables are read when they are asked for, each once.

    Attributes:
        folder: where its files are (docs/RESULTS.md).
        summary: the content of `summary.json`: every metric by its name, such as `summary["told_s"]["mean"]` [s].
    """

    def __init__(self, folder: Path, summary: dict[str, Any], keeper: object = None) -> None:
        self.folder, self.summary = folder, summary
        self._keeper = keeper
        """What deletes a temporary folder when nobody has this object any more."""

    def __repr__(self) -> str:
        name, mode, seed = (self.summary[key] for key in ("name", "mode", "seed"))
        state = "valid" if self.is_valid else "not valid: " + "; ".join(self.summary["invalid_because"])
        return f"<Run {name}, {mode}, seed {seed}, {self.summary['steps']} steps, {state}>"

    @property
    def is_valid(self) -> bool:
        """Whether its numbers may be used; `summary["invalid_because"]` says why not."""
        return bool(self.summary["valid"])

    @property
    def digest(self) -> str | None:
        """Its digest, equal for equal scenario, seed and code; None if it ended too early."""
        digest: str | None = self.summary["digest"]
        return digest

    @cached_property
    def scenario(self) -> dict[str, Any]:
        """Its effective scenario, with every key, as nested tables."""
        return tomllib.loads(self._file("scenario.toml").read_text(encoding="utf-8"))

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Where its results come from: versions, host, code, engine, and how it ended."""
        return dict(json.loads(self._file("manifest.json").read_text(encoding="utf-8")))

    @cached_property
    def series(self) -> "pd.DataFrame":
        """A row per step. Columns are those of `series.csv` (docs/RESULTS.md); an empty cell is NaN.

        Among them are `step`, `time_s` [s], `agents_in_trees`, `covered_area_m2` [m2], `events_open`, `frames_sent`,
        `frames_received`, `dropped_<reason>`, `reports_arrived`, `operator_messages` (in the step) and
        `operator_rate_60s_hz` (the workload: messages per second over the last 60 s [1/s]).

        Raises:
            Error: pandas is not installed, or the run is not over.
        """
        return self._table("series")

    @cached_property
    def events(self) -> "pd.DataFrame":
        """A row per event, in order of arrival; a time that has not come is NaN.

        Columns: `event`, `x_m`, `y_m` [m], `arrived_s`, `sensed_s`, `told_s` (the operator was told), `worked_s` (work
        began), `completed_s` [s], and `work_agent_s` [agent s].

        Raises:
            Error: pandas is not installed, or the run is not over.
        """
        return self._table("events")

    @cached_property
    def reports(self) -> "pd.DataFrame":
        """A row per report that reached the operator, in order of arrival.

        Columns: `arrived_step`, `arrived_s` [s], `agent`, `sequence` (its number), `step` (in which it was sent),
        `role`, `x_m`, `y_m` (the sender's place) [m], `followers`, `events` (a tuple of ids), `members` (a tuple of
        ids), `delta`.

        Raises:
            Error: pandas is not installed, or there is no recording (scenario key `record = "off"`).
        """
        with one_error("run.reports"):
            import pandas as pd

            recording = self._film().recording
            times_s = {record.step: record.time_s for record in recording.step_records}
            rows = [
                {
                    "arrived_step": step,
                    "arrived_s": times_s.get(step),
                    **{name: getattr(report, name) for name in REPORT_COLUMNS[2:]},
                    "events": tuple(event.event for event in report.events),
                    "members": tuple(member.agent for member in report.members),
                }
                for step, reports in sorted(recording.reports.items())
                for report in reports
            ]
            return pd.DataFrame(rows, columns=REPORT_COLUMNS)

    @cached_property
    def poses(self) -> "pd.DataFrame":
        """A row per view and agent: the truth that viewers show.

        Columns: `step`, `time_s` [s], `agent`, `x_m`, `y_m` [m], `role`, `level`, `parent`, `root` (-1: none), `delta`.
        Of bodies also `heading_rad`, `left_mps`, `right_mps`; of those that fly `height_m`, `roll_rad`, `pitch_rad`.

        Raises:
            Error: pandas is not installed, or there is no recording (scenario key `record = "off"`).
        """
        with one_error("run.poses"):
            import pandas as pd

            from deltaswarm_scenario.truth import AgentState

            rows = [(view.step, view.time_s, *body) for view in self._film().snapshots() for body in view.bodies]
            return pd.DataFrame(rows, columns=["step", "time_s", *AgentState._fields])

    @public(time_s=(0.0, MAX_NUMBER))
    def show(self, time_s: float | None = None) -> "Figure":
        """Draw the swarm from above: agents by role, trees, and open events; a notebook shows the figure.

        Args:
            time_s: the newest view up to this time [s]; None: the end of the run.

        Raises:
            Error: matplotlib is not installed, there is no recording, or no view up to this time.
        """
        with one_error("run.show"):
            from deltaswarm_orchestrator.export.picture import Picture

            film = self._film()
            views = (view for view in film.snapshots() if time_s is None or view.time_s <= time_s)
            last = None
            for view in views:
                last = view
            if last is None:
                raise Error(f"time_s must be at least that of the first view (got {time_s})")
            picture = Picture(film)
            picture.show(last)
            return picture.figure

    @public()
    def record(self, file: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Write the recording to a file: `.mcap` as it is, `.rrd` for Rerun, or `.mp4`, a video; return its path.

        Raises:
            Error: there is no recording, the ending is another one, or the file exists (`force` replaces it).
        """
        with one_error("run.record"):
            from deltaswarm_orchestrator.export.formats import FORMATS, export

            path = Path(file)
            formats = {form.suffix: name for name, form in FORMATS.items() if form.suffix.startswith(".")}
            if path.suffix not in formats:
                hint = did_you_mean(path.suffix, formats)
                raise Error(f"file must end in {', '.join(formats)} (got {str(path)!r}{hint and f'; {hint.strip()}'})")
            self._needs_recording()
            export(self.folder, formats[path.suffix], path, force=force)
            return path

    def _file(self, name: str) -> Path:
        file = self.folder / name
        if not file.exists():
            raise Error(f"{self.folder} has no {name}: the run is not over, or its folder was moved", code=FAILED)
        return file

    def _table(self, name: str) -> "pd.DataFrame":
        with one_error(f"run.{name}"):
            import pandas as pd

            return _with_numbers(pd.read_csv(self._file(f"{name}.csv")))

    def _needs_recording(self) -> None:
        if self.scenario["record"] == "off":
            raise Error("there is no recording: the scenario's key record must not be off")

    def _film(self) -> "Film":
        from deltaswarm_orchestrator.export.snapshots import read_film
        from deltaswarm_orchestrator.recording.reader import RecordingError, recording_in

        self._needs_recording()
        try:
            return read_film(recording_in(self.folder))
        except (FileNotFoundError, RecordingError) as error:
            raise Error(str(error), code=FAILED) from None


class UnsavedRun(Run):
    """A run of a sweep in this process, which has no folder and no recording."""

    def __init__(self, outcome: "Outcome", scenario: Scenario, summary: dict[str, Any]) -> None:
        super().__init__(Path(), summary)
        self._outcome, self._settings = outcome, scenario

    @cached_property
    def scenario(self) -> dict[str, Any]:
        settings: dict[str, Any] = checked.plain(self._settings)
        return settings

    def _table(self, name: str) -> "pd.DataFrame":
        import pandas as pd

        from deltaswarm_orchestrator.results.outcome import EventLife
        from deltaswarm_orchestrator.results.run_tables import series_rows

        if name == "events":
            return _with_numbers(pd.DataFrame(self._outcome.lives, columns=EventLife._fields))
        header, rows = series_rows(self._outcome)
        return _with_numbers(pd.DataFrame(rows, columns=header))


def _with_numbers(table: "pd.DataFrame") -> "pd.DataFrame":
    """Make NaN of what has no value at all, such as the times of events that nobody completed; pandas keeps objects."""
    return table.astype({name: float for name in table if table[name].isna().all()})


REPORT_COLUMNS = (
    *("arrived_step", "arrived_s", "agent", "sequence", "step", "role", "x_m", "y_m", "followers", "events", "members"),
    "delta",
)
