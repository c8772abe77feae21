"""All that the page says, as tables: worked out from the sweeps, kept as CSV, and read again."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.limits.effects import comparisons_of, estimates_of
from deltaswarm_orchestrator.limits.experiments import EXPERIMENTS, Experiment
from deltaswarm_orchestrator.limits.recovery import COLUMNS, recovery_of
from deltaswarm_orchestrator.limits.runs import runs_of, windows_of
from deltaswarm_wire.files import write_whole

NOT_PUBLISHED = ("windows",)
"""Large, and needed by the figures only."""


def _empty() -> pd.DataFrame:
    return pd.DataFrame()


@dataclass(frozen=True)
class Findings:
    """Tables over all experiments that were done, in the experiments' order."""

    sweeps: pd.DataFrame = field(default_factory=_empty)
    """A row per experiment: where its runs come from."""
    runs: pd.DataFrame = field(default_factory=_empty)
    estimates: pd.DataFrame = field(default_factory=_empty)
    comparisons: pd.DataFrame = field(default_factory=_empty)
    recovery: pd.DataFrame = field(default_factory=_empty)
    windows: pd.DataFrame = field(default_factory=_empty)

    @property
    def experiments(self) -> list[Experiment]:
        """Those that were done."""
        return [EXPERIMENTS[str(name)] for name in self.sweeps["experiment"]]

    def save(self, folder: Path, *, without: Iterable[str] = ()) -> list[Path]:
        """Write a CSV for each table, whole or not at all.

        Raises:
            OSError: one cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        written = []
        for name in (one.name for one in fields(self)):
            if name not in without:
                file = folder / f"{name}.csv"
                write_whole(file, getattr(self, name).to_csv(index=False).encode())
                written.append(file)
        return written

    @classmethod
    def load(cls, folder: Path) -> "Findings":
        """The tables of a folder; those that it lacks are empty.

        Raises:
            OSError: a file cannot be read.
        """
        found = {}
        for name in (one.name for one in fields(cls)):
            file = folder / f"{name}.csv"
            if file.exists() and file.stat().st_size > 1:
                found[name] = pd.read_csv(file)
        return cls(**found)


@dataclass(frozen=True)
class Done:
    """An experiment's sweep, finished."""

    experiment: Experiment
    manifest: dict[str, Any]
    table: pd.DataFrame
    series: pd.DataFrame
    step_s: float


def findings_of(done: Iterable[Done]) -> Findings:
    """Work it all out.

    Raises:
        ValueError: a sweep's tables are not those of its experiment.
    """
    parts: dict[str, list[pd.DataFrame]] = {one.name: [] for one in fields(Findings)}
    for one in done:
        windows = windows_of(one.experiment, one.series, one.step_s)
        runs = runs_of(one.experiment, one.table, windows)
        parts["sweeps"].append(pd.DataFrame([_provenance(one)]))
        parts["runs"].append(runs)
        parts["estimates"].append(estimates_of(one.experiment, runs))
        parts["comparisons"].append(comparisons_of(one.experiment, runs))
        if one.experiment.fault is not None:
            parts["windows"].append(windows)
            parts["recovery"].append(recovery_of(one.experiment, windows))
    found = {name: pd.concat(tables, ignore_index=True) for name, tables in parts.items() if tables}
    found.setdefault("recovery", pd.DataFrame(columns=list(COLUMNS)))
    return Findings(**found)


def _provenance(done: Done) -> dict[str, Any]:
    manifest = done.manifest
    return {
        "experiment": done.experiment.name,
        "runs": manifest["finished"],
        "repeats": manifest["repeats"],
        "duration_s": float(done.table["steps"].max()),
        "by_processes": manifest["proofs"]["checked"],
        "equal_digests": manifest["proofs"]["equal"],
        "digest": manifest["digest"] or "-",
        "begun": manifest["started"],
        "wall_min": round(manifest["wall_s"] / 60, 1),
        "version": manifest["versions"]["deltaswarm"] or "-",
        "code": " ".join(manifest["code"]) or "-",
    }
