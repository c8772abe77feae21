"""One study: done from Python or by the command line, judged, and written as a page."""

import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from deltaswarm import sweeps
from deltaswarm.arguments import COUNTS, public
from deltaswarm.errors import in_python, one_error
from deltaswarm.keys import check_importable, overrides
from deltaswarm.runs import IN_PROCESS, PROCESSES
from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import FAILED, MISSED, OK, CommandError
from deltaswarm_orchestrator.base.paths import check_files, check_out
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_orchestrator.sweeps.runner import SweepResult
from deltaswarm_orchestrator.sweeps.table import invalid_line, read_table
from deltaswarm_studies.costs import with_costs
from deltaswarm_studies.events import events_of
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.freezing import refuse_uncommitted
from deltaswarm_studies.load import OF_A_STUDY, load_study
from deltaswarm_studies.origin import PROVENANCE, WITH_THE_RUNS, provenance_of, sealed_tables
from deltaswarm_studies.page import write
from deltaswarm_studies.plan import too_few
from deltaswarm_studies.protocol import Protocol, protocol_of, seeded, some
from deltaswarm_studies.settings import CONFIRMATORY
from deltaswarm_studies.study import Study

Conduct = Callable[[Sweep, Path], SweepResult]
"""Does the missing runs of a sweep in a folder."""


@dataclass(frozen=True)
class StudyResult:
    """A study with its runs, its verdicts and its page.

    Attributes:
        folder: where its files are.
        evidence: all its results, a data frame for each kind: `contrasts`, `claims`, `estimates`, `survival`, `fits`.
    """

    study: Study
    folder: Path
    evidence: Evidence
    protocol: Protocol
    sealed: str
    """Since when its tables are sealed; empty: they are not."""

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {verdict}" for verdict, count in self._verdicts.items())
        return f"<Study {self.study.name}, {len(self.runs)} runs, claims: {counts or 'none'}, {self.page}>"

    @property
    def _verdicts(self) -> dict[str, int]:
        return dict(self.claims["verdict"].value_counts()) if len(self.claims) else {}

    @property
    def page(self) -> Path:
        """The page with figures, tables and verdicts."""
        return self.folder / "page.html"

    @property
    def claims(self) -> pd.DataFrame:
        """A row per claim, with its `verdict`; docs/STUDIES.md has the columns."""
        return self.evidence.claims

    @property
    def runs(self) -> pd.DataFrame:
        """A row per run: `variant`, `replicate`, `seed`, and a column for each metric of the study."""
        return self.evidence.runs

    @property
    def unsealed(self) -> str:
        """A line if the tables are not sealed."""
        line = f"{self.study.name}: the tables in {self.folder} are not sealed, so nobody can tell whether they were"
        return "" if self.sealed else f"{line} changed"

    def complaints(self) -> list[str]:
        """Return what did not go as it should, a line each."""
        evidence = self.evidence
        lines = [*self.protocol.problems, *evidence.warnings]
        lines += [f"not as expected: {line}" for line in evidence.surprises]
        return [f"{self.study.name}: {line}" for line in lines]

    def code(self) -> int:
        """Return the exit code of the command line."""
        evidence = self.evidence
        missed = [*self.protocol.problems, *evidence.surprises]
        return FAILED if evidence.incomplete or evidence.undrawn else MISSED if missed else OK


@public(replicates=COUNTS, jobs=COUNTS)
def study(
    study: str | os.PathLike[str],
    keys: Mapping[Any, Any] | None = None,
    *,
    replicates: int | None = None,
    jobs: int | None = None,
    engine: str = IN_PROCESS,
    scheduler: str | None = None,
    render: bool = False,
    out: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> StudyResult:
    """Do the missing runs of a study, as `deltaswarm study` does it, judge its claims, and write its page.

    What does not hold, and what the tables lack, is a warning, as on the command line.

    Args:
        study: a built-in study (`deltaswarm list`) or a TOML file.
        keys: scenario keys for all runs, as for `run`; classes must be in a module.
        replicates: runs of each variant; None: as the file says.
        jobs: runs in parallel; None: one per core.
        engine: "in-process", "processes" (a process for each agent), or an engine such as "dask".
        scheduler: with an engine: the address of its scheduler.
        render: run nothing: make the page again from the folder's tables.
        out: the folder; None: `studies/NAME`.
        progress: show a bar on a terminal or in a notebook.

    Raises:
        Error: the study or its keys have mistakes, runs are missing, or a package of the extra `study` is.
    """
    with one_error("deltaswarm.study"):
        given = overrides(keys or {})
        check_importable(given, "a study's runs are kept, and must be repeatable from its files")
        loaded = load_study(os.fspath(study), given, {"repeats": replicates})
        folder = Path(out or Path("studies") / loaded.name)
        loaded = seeded(loaded, folder)
        means = PROCESSES if engine == PROCESSES else IN_PROCESS
        lines: list[str] = []

        def conduct(sweep: Sweep, runs: Path) -> SweepResult:
            local = (IN_PROCESS, PROCESSES)
            make = sweeps.engine_maker(engine, scheduler, jobs, means, path="engine", local=local)
            with_series = bool(sweep.file.sweep.series_every_s)
            result = sweeps.conduct(sweep, runs, make, means=means, quiet=not progress, with_series=with_series)
            lines.extend(sweeps.complaints(result))
            return result

        check_files(folder)
        check_out(folder, among=() if render else OF_A_STUDY)
        if not render:
            sweeps.check(loaded.sweep, folder / "sweep", means)
            if told := [line for some in beforehand(loaded, folder) for line in some]:
                warnings.warn(in_python("\n".join(told)), stacklevel=3)
        try:
            file = file_of(loaded, os.fspath(study))
            done = concluded(loaded, folder, None if render else conduct, file)
        except FileNotFoundError as error:
            raise CommandError(f"{loaded.name}: {error.filename} is not there; render=False makes it", FAILED) from None
        except ValueError as error:
            raise CommandError(f"{loaded.name}: {error}", FAILED) from None
        lines += done.complaints()
    if lines:
        warnings.warn(in_python("\n".join(lines)), stacklevel=3)
    return done


def beforehand(study: Study, folder: Path) -> tuple[list[str], list[str]]:
    """Return what is wrong with a study's protocol, and what is worth knowing, before hours are spent."""
    protocol = protocol_of(study, folder)
    notes = []
    if not protocol.entries and protocol.kind == CONFIRMATORY and not (folder / "sweep").exists():
        freeze = "`deltaswarm study --freeze` fixes what it asks and expects before its first run"
        notes.append(f"{study.name}: not frozen ({freeze})")
    problems, changed = protocol.problems, protocol.changed_files()
    if changed:
        problems = [
            *problems,
            f"the code changed since its protocol ({some(changed)}); --amend before the runs says why",
        ]
    return [f"{study.name}: {line}" for line in problems], notes + too_few(study)


def file_of(study: Study, given: str) -> Path | None:
    """Return the file of a study that was given by a name or a file; None if it is built in."""
    return Path(given) if not study.is_built_in and Path(given).is_file() else None


def concluded(study: Study, folder: Path, conduct: Conduct | None, file: Path | None) -> StudyResult:
    """Do a study's runs, or without `conduct` read its tables; judge it and write its page.

    `file` is the study's, if it is not built in.

    Raises:
        CommandError: the sweep could not start, a run failed, or the folder is published and the code not committed.
        OSError, ValueError: a table cannot be read.
    """
    if provenance.is_tracked(folder):
        refuse_uncommitted(study, file)
    sealed = WITH_THE_RUNS
    if conduct is None:
        sealed = sealed_tables(folder, study).get("sealed", "")
        evidence = Evidence.of_folder(study, folder)
        recorded = read_table(folder / "provenance.csv", needs=[*PROVENANCE])
    else:
        evidence, recorded = _conducted(study, folder, conduct)
    write(study, evidence, recorded, folder, sealed)
    protocol = protocol_of(study, folder, recorded, evidence.runs, is_sealed=bool(sealed))
    return StudyResult(study, folder, evidence, protocol, sealed)


def _conducted(study: Study, folder: Path, conduct: Conduct) -> tuple[Evidence, pd.DataFrame]:
    """Do a study's runs; return the evidence and the runs' provenance."""
    result = conduct(study.sweep, folder / "sweep")
    if not (result.is_well or result.has_all_but_invalid):
        example = invalid_line(result.invalid, result.runs)
        because = f": {example}" if example else ""
        raise CommandError(
            f"{study.name}: {result.finished} of {result.runs} runs are done and valid; no page{because}", result.code
        )
    table = with_costs(study, result.table, result.kept)
    evidence = Evidence.of_sweep(study, table, result.series, result.invalid, events_of(study, result.kept))
    return evidence, provenance_of(study, result.manifest, protocol_of(study, folder).changed_files())
