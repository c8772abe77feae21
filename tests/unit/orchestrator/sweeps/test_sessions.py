"""The sessions of a sweep: their time, what its manifest says meanwhile, and how many runs go on side by side."""

import json
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from deltaswarm_orchestrator.sweeps.engine import Done
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES, Task, default_workers
from tests.unit.orchestrator.sweeps.test_runner import Here, conducted, planned


def test_wall_time_adds_up_over_the_sessions(tmp_path: Path) -> None:
    """At least as long as its runs took, at most as long as was waited; a session that does nothing adds little."""
    began = time.monotonic()
    first = conducted(planned(repeats=1), tmp_path / "out", Here()).manifest["wall_s"]
    passed = time.monotonic() - began
    costs = pd.read_csv(tmp_path / "out" / "costs.csv")
    assert costs["wall_s"].sum() <= first <= passed
    both = conducted(planned(), tmp_path / "out", Here()).manifest["wall_s"]
    assert first < both <= time.monotonic() - began


def test_a_manifest_of_a_sweep_under_way_claims_nothing(tmp_path: Path) -> None:
    """Before its first tables there are no finished runs, proofs or digests; later those of the last tables stand."""
    seen = list[tuple[Any, ...]]()

    class Looking(Here):
        def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
            found = json.loads((tmp_path / "out" / "manifest.json").read_text())
            proofs = found["proofs"]
            seen.append((found["finished"], proofs["checked"], proofs["equal"], found["digest"], found["sessions"]))
            yield from super().run(tasks)

    conducted(planned(prove=1), tmp_path / "out", Looking(stops_after=3))
    result = conducted(planned(prove=1), tmp_path / "out", Looking())
    conducted(planned(repeats=3, prove=1), tmp_path / "out", Looking())
    assert result.is_well
    assert seen == [(0, 0, 0, None, 1), (3, 0, 0, None, 2), (0, 0, 0, None, 3)]


def test_a_series_that_was_asked_for_once_keeps_up_with_the_table(tmp_path: Path) -> None:
    """A later session that does not ask for it writes it all the same; a sweep that never asks has none."""
    conducted(planned(repeats=1), tmp_path / "never", Here())
    assert not (tmp_path / "never" / "series.csv").exists()
    first = conducted(planned(repeats=1), tmp_path / "out", Here(), with_series=True).series
    later = conducted(planned(repeats=2), tmp_path / "out", Here()).series
    assert (set(first["replicate"]), set(later["replicate"])) == ({0}, {0, 1})
    assert len(pd.read_csv(tmp_path / "out" / "series.csv")) == len(later) == 2 * len(first) > 0


@pytest.mark.parametrize(("cores", "by_one", "by_many"), [(1, 1, 1), (2, 2, 1), (9, 9, 4)])
def test_runs_side_by_side_fill_the_cores(
    cores: int, by_one: int, by_many: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two for a run by processes."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
    assert (default_workers(IN_PROCESS), default_workers(PROCESSES)) == (by_one, by_many)
