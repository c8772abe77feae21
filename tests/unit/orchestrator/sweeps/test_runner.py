"""A sweep's folder: what is finished stays, what is missing is done, and whose folder it is."""

import errno
import json
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import orjson
import pandas as pd
import pytest

from deltaswarm.errors import error_of
from deltaswarm.sweeps import each_trace_once
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.seal import SealError
from deltaswarm_orchestrator.sweeps.engine import Done
from deltaswarm_orchestrator.sweeps.folder import SweepFolder, SweepFolderError
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES, Task, work
from deltaswarm_orchestrator.sweeps.load import load_sweep
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_orchestrator.sweeps.runner import SweepReporter, SweepResult, check_folder, run_sweep
from tests.support.sweeping import made

Printed = pytest.CaptureFixture[str]


class Here:
    """An engine without workers, which notes what it was given; fails or is interrupted as a test says."""

    def __init__(self, fails: Callable[[Task], bool] = lambda task: False, stops_after: int | None = None) -> None:
        self.given: list[str] = []
        self._fails = fails
        self._stops_after = stops_after

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        self.given += [f"{task.job.name} {task.means}" for task in tasks]
        for index, task in enumerate(tasks):
            if index == self._stops_after:
                raise KeyboardInterrupt
            if self._fails(task):
                yield Done(task, None, "it was told to")
            else:  # nobody needs the real processes here, but their results
                yield Done(task, work(Task(task.job)) | {"means": task.means})


def planned(repeats: int = 2, losses: Sequence[float] = (0.0, 0.4), prove: int = 0, **other: Any) -> Sweep:
    return made({"axes": {"radio.loss": list(losses)}, "repeats": repeats, "prove": prove}, **other)


def conducted(sweep: Sweep, out: Path, engine: Here, **options: Any) -> SweepResult:
    return run_sweep(sweep, out, lambda: engine, SweepReporter(), **options)


def test_a_run_that_fails_for_two_labels_is_invalid_for_both(tmp_path: Path) -> None:
    """One was tried for both, so that neither is just missing."""
    losses = {"base": 0.0, "no loss": 0.0, "half": 0.5}
    variants = [{"label": label, "radio.loss": loss} for label, loss in losses.items()]
    sweep = made({"variants": variants, "repeats": 2, "prove": 0})
    result = conducted(sweep, tmp_path, Here(lambda task: task.job.variant.label == "base" and task.job.replicate == 1))
    assert [(row["variant"], row["replicate"]) for row in result.invalid] == [("base", 1), ("no loss", 1)]
    assert result.has_all_but_invalid


def runs(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in (folder / "runs").iterdir()}


# What is done, and what is not done again


def test_a_finished_sweep_is_not_done_again(tmp_path: Path) -> None:
    first = conducted(planned(), tmp_path / "out", Here())
    assert (first.runs, first.finished, first.is_well) == (4, 4, True)
    table, files = (tmp_path / "out" / "table.csv").read_bytes(), runs(tmp_path / "out")

    def no_engine() -> Here:
        raise AssertionError

    again = run_sweep(planned(), tmp_path / "out", no_engine, SweepReporter())
    assert again.is_well
    assert ((tmp_path / "out" / "table.csv").read_bytes(), runs(tmp_path / "out")) == (table, files)
    assert again.manifest["sessions"] == 2
    assert again.manifest["digest"] == first.manifest["digest"]
    assert again.manifest["started"] == first.manifest["started"]


def test_an_interrupted_sweep_goes_on_where_it_was(tmp_path: Path) -> None:
    """What was finished is in the tables at once; the next call does the rest, and nothing twice."""
    undisturbed = conducted(planned(), tmp_path / "whole", Here())
    cut = conducted(planned(), tmp_path / "out", Here(stops_after=3))
    assert (cut.finished, cut.interrupted, cut.is_well) == (3, True, False)
    assert len(pd.read_csv(tmp_path / "out" / "table.csv")) == 3
    assert cut.manifest["digest"] is None
    rest = Here()
    result = conducted(planned(), tmp_path / "out", rest)
    assert rest.given == ["loss=0.4, replicate 1 in-process"]
    assert result.is_well
    assert result.manifest["digest"] == undisturbed.manifest["digest"]
    assert (tmp_path / "out" / "table.csv").read_bytes() == (tmp_path / "whole" / "table.csv").read_bytes()


def test_a_sweep_that_is_interrupted_before_its_proofs_is_not_well(tmp_path: Path) -> None:
    cut = conducted(planned(prove=1), tmp_path / "out", Here(stops_after=4))
    assert (cut.finished, cut.runs, cut.is_well) == (4, 4, False)


@pytest.mark.parametrize(
    ("extended", "missing"),
    [
        (planned(repeats=3), ["loss=0.0, replicate 2 in-process", "loss=0.4, replicate 2 in-process"]),
        (planned(losses=(0.0, 0.2, 0.4)), ["loss=0.2, replicate 0 in-process", "loss=0.2, replicate 1 in-process"]),
        (planned(prove=4), [f"loss={loss}, replicate {r} processes" for r in (0, 1) for loss in (0.0, 0.4)]),
        (planned(repeats=1), []),
    ],
    ids=["more replicates", "another variant", "more proofs", "fewer replicates"],
)
def test_a_sweep_can_be_extended(tmp_path: Path, extended: Sweep, missing: list[str]) -> None:
    """What is finished is kept; what is not asked for any more is kept too, but not in the table."""
    conducted(planned(), tmp_path / "out", Here())
    before = runs(tmp_path / "out")
    engine = Here()
    result = conducted(extended, tmp_path / "out", engine)
    assert sorted(engine.given) == sorted(missing)
    assert before.items() <= runs(tmp_path / "out").items()
    assert result.is_well
    assert len(result.table) == result.runs == len(extended.jobs())


def test_a_run_is_done_once_though_two_variants_have_it(tmp_path: Path) -> None:
    same = made({"variants": [{"label": "base"}, {"label": "delta 3", "control.delta": 3}], "repeats": 2, "prove": 0})
    engine = Here()
    result = conducted(same, tmp_path / "out", engine)
    assert engine.given == ["base, replicate 0 in-process", "base, replicate 1 in-process"]
    assert result.is_well
    assert list(result.table["variant"]) == ["base", "base", "delta 3", "delta 3"]
    assert result.table["digest"].nunique() == 2


def test_what_failed_is_said_and_tried_again_by_the_next_call(tmp_path: Path) -> None:
    result = conducted(planned(), tmp_path / "out", Here(lambda task: task.job.name == "loss=0.4, replicate 0"))
    [failed] = result.failed
    assert "loss=0.4, replicate 0" in failed
    assert (result.finished, result.is_well, result.manifest["digest"]) == (3, False, None)
    engine = Here()
    assert conducted(planned(), tmp_path / "out", engine).is_well
    assert engine.given == ["loss=0.4, replicate 0 in-process"]


def test_when_all_fail_there_are_tables_all_the_same(tmp_path: Path) -> None:
    result = conducted(planned(), tmp_path / "out", Here(lambda task: True), with_series=True)
    assert (result.finished, len(result.failed), len(result.table)) == (0, 4, 0)
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["finished"] == 0
    assert (tmp_path / "out" / "series.csv").exists()


@pytest.mark.parametrize("means", [IN_PROCESS, PROCESSES])
@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: b"",
        lambda data: data[: len(data) // 2],
        lambda data: b"[]",
        lambda data: b"\xff" * 10,
        lambda data: data.replace(b'"transport_lost":0', b'"transport_lost":1'),
        lambda data: orjson.dumps({name: part for name, part in orjson.loads(data).items() if name != "checksum"}),
    ],
    ids=["empty", "cut off", "a list", "no text", "a digit", "no checksum"],
)
def test_a_damaged_file_is_no_finished_run(tmp_path: Path, means: str, spoil: Callable[[bytes], bytes]) -> None:
    """Were it one digit that changed: it is said, and the run is done again."""
    sweep = planned(repeats=1, prove=1)
    first = conducted(sweep, tmp_path / "out", Here())
    folder = SweepFolder(tmp_path / "out")
    (proven,) = sweep.sample(sweep.jobs())
    file = folder.file(proven, means)
    table, whole = (tmp_path / "out" / "table.csv").read_bytes(), file.read_bytes()
    file.write_bytes(spoil(whole))
    assert file.read_bytes() != whole
    engine = Here()
    result = conducted(sweep, tmp_path / "out", engine)
    assert result.damaged == [str(file)]
    assert (tmp_path / "out" / "table.csv").read_bytes() == table
    assert engine.given == [f"{proven.name} {means}"]
    assert result.is_well
    assert result.manifest["digest"] == first.manifest["digest"]


def test_a_damaged_file_of_a_run_is_named(tmp_path: Path, capsys: Printed) -> None:
    sweep = load_sweep("smoke", ["run.duration_s=60"], {"repeats": 1, "prove": 0})
    conducted(sweep, tmp_path / "out", Here())
    file = SweepFolder(tmp_path / "out").file(sweep.jobs()[0], IN_PROCESS)
    file.write_bytes(b"{}")
    command = ["sweep", "smoke", "--set", "run.duration_s=60", "--repeats", "1", "--prove", "0"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 0
    assert str(file) in capsys.readouterr().err


# The proof


def forge(folder: Path, sweep: Sweep, means: str, what: str = "digest") -> str:
    """Another digest in the file of the run that real processes did too; its name."""
    (proven,) = sweep.sample(sweep.jobs())
    kept = SweepFolder(folder)
    result = kept.result(proven, means)
    assert result is not None
    result["summary"][what] = "0" * 32
    kept.save(proven, means, result)
    return proven.name


@pytest.mark.parametrize(
    ("means", "what"), [(IN_PROCESS, "digest"), (PROCESSES, "digest"), (PROCESSES, "events_digest")]
)
def test_a_difference_between_the_means_is_found(tmp_path: Path, means: str, what: str) -> None:
    """Whichever of the two is forged, and in what was said or in what happened."""
    sweep = planned(prove=1)
    assert conducted(sweep, tmp_path / "out", Here()).manifest["proofs"] == {"checked": 1, "equal": 1}
    name = forge(tmp_path / "out", sweep, means, what)
    result = conducted(sweep, tmp_path / "out", Here())
    assert result.differing == [name]
    assert result.manifest["proofs"] == {"checked": 1, "equal": 0}
    assert not result.is_well


def test_the_command_says_which_runs_differ_and_ends_with_1(tmp_path: Path, capsys: Printed) -> None:
    """On standard error; the table is written all the same."""
    sweep = load_sweep("smoke", ["run.duration_s=60"], {"repeats": 1})
    conducted(sweep, tmp_path / "out", Here())
    name = forge(tmp_path / "out", sweep, IN_PROCESS)
    arguments = ["sweep", "smoke", "--set", "run.duration_s=60", "--repeats", "1", "--out", str(tmp_path / "out")]
    assert main(arguments) == 1
    printed = capsys.readouterr()
    assert f"deltaswarm: digests differ between one process and real processes: {name}" in printed.err
    assert re.search(r"real processes: 1, .*: 0$", printed.out, flags=re.MULTILINE)


# Whose folder it is


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    """By the same sweep as by another; when it is free it can be had."""
    folder = SweepFolder(tmp_path / "out")
    for name in ("mine", "other"):
        with folder.held("mine"), pytest.raises(SweepFolderError, match="another sweep"):
            conducted(planned(name=name), tmp_path / "out", Here())
    assert conducted(planned(), tmp_path / "out", Here()).is_well


def test_another_sweeps_folder_is_refused(tmp_path: Path) -> None:
    conducted(planned(), tmp_path / "out", Here())
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "out").rglob("*")}
    with pytest.raises(SweepFolderError, match=r"'mine'.*'other'"):
        conducted(planned(name="other"), tmp_path / "out", Here())
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "out").rglob("*")} == before


def files_of(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_another_experiment_does_not_replace_the_table_of_the_first(tmp_path: Path, capsys: Printed) -> None:
    """A sweep that shares no run with the folder is refused: exit code 2, what is another, and what to do."""
    out = tmp_path / "out"
    short = ["sweep", "smoke", "--repeats", "1", "--prove", "0", "--out", str(out)]
    assert main([*short, "--set", "run.duration_s=60"]) == 0
    before = files_of(out)
    capsys.readouterr()
    assert main([*short, "--set", "run.duration_s=90"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    for fact in (f"{out} holds 4 runs", "scenario.run.duration_s was 60, is 90", "--out"):
        assert fact in line
    assert main([*short, "--set", "run.duration_s=60", "--seed", "9"]) == 2
    assert "(sweep.seed was 1, is 9)" in capsys.readouterr().err
    assert files_of(out) == before


def test_a_report_of_another_table_is_said_to_be_one(tmp_path: Path, capsys: Printed) -> None:
    """After the sweep was extended, until the report is made anew."""
    out = str(tmp_path / "out")
    command = ["sweep", "smoke", "--set", "run.duration_s=40", "--prove", "0", "--out", out, "--repeats"]
    told = (
        f"deltaswarm: {tmp_path / 'out' / 'page.md'} does not match table.csv; to update it: deltaswarm report {out}\n"
    )
    assert main([*command, "1"]) == main(["report", out]) == main([*command, "1"]) == 0
    assert "report" not in capsys.readouterr().err
    for _ in range(2):
        assert main([*command, "2"]) == 0
        assert told in capsys.readouterr().err
    assert main(["report", out]) == main([*command, "2"]) == 0
    assert told not in capsys.readouterr().err


@pytest.mark.parametrize("content", ["notes.txt", "manifest.json", "a file"])
def test_a_folder_of_something_else_is_refused(tmp_path: Path, content: str) -> None:
    """Whatever is in it; also a single run's folder of the same name, which has a manifest too."""
    out = tmp_path / "out"
    if content == "a file":
        out.write_text("")
    else:
        out.mkdir()
        (out / content).write_text('{"name": "mine", "seed": 1}')
    with pytest.raises(SweepFolderError, match="holds no sweep"):
        conducted(planned(), out, Here())
    with pytest.raises(SweepFolderError, match="holds no sweep"):  # as `--dry-run` does
        check_folder(planned(), out, IN_PROCESS)
    assert [file.name for file in tmp_path.rglob("*")] == (["out"] if content == "a file" else ["out", content])


@pytest.mark.parametrize("manifest", [b"", b"[1]", b"\xff", b'{"swept": ["a"]'])
def test_a_sweeps_folder_with_a_spoilt_manifest_is_refused(tmp_path: Path, manifest: bytes) -> None:
    conducted(planned(), tmp_path / "out", Here())
    (tmp_path / "out" / "manifest.json").write_bytes(manifest)
    with pytest.raises(SealError, match=r"manifest\.json"):
        conducted(planned(), tmp_path / "out", Here())


@pytest.mark.parametrize("made_so_far", [[], [".lock"], [".lock", "runs"], [".lock", "runs", "scratch"]], ids=len)
def test_a_sweep_that_was_killed_before_its_manifest_goes_on(tmp_path: Path, made_so_far: list[str]) -> None:
    """Its folder is its own from the first thing in it."""
    (tmp_path / "out").mkdir()
    for name in made_so_far:
        (tmp_path / "out" / name).touch() if name == ".lock" else (tmp_path / "out" / name).mkdir()
    assert conducted(planned(), tmp_path / "out", Here()).is_well


def test_a_folder_without_its_lock_is_still_a_sweeps(tmp_path: Path) -> None:
    """Copies often come without hidden files."""
    conducted(planned(), tmp_path / "out", Here())
    (tmp_path / "out" / ".lock").unlink()
    engine = Here()
    assert conducted(planned(), tmp_path / "out", engine).is_well
    assert engine.given == []


@pytest.mark.parametrize("where", ["file/out", "x" * 300, "/proc/none"])
def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path, where: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SweepFolderError, match="cannot be"):
        conducted(planned(), tmp_path / where, Here())
    assert main(["sweep", "smoke", "--out", str(tmp_path / where)]) == 2


def test_a_result_that_cannot_be_written_ends_the_sweep_as_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk, say: not as a mistake of usage; the file and the cause are named."""

    def full(file: Path, data: bytes) -> None:
        if file.parent.name == "runs":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))
        file.write_bytes(data)

    monkeypatch.setattr("deltaswarm_orchestrator.sweeps.folder.write_whole", full)
    sweep, out = planned(), tmp_path / "out"
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)) as caught:
        conducted(sweep, out, Here())
    told = error_of(caught.value, "deltaswarm sweep")
    assert told is not None
    assert str(SweepFolder(out).file(sweep.jobs()[0], IN_PROCESS)) in str(told)
    assert told.code == 1


def test_the_traceback_of_many_runs_is_shown_once() -> None:
    """Each run has its line; one that raised elsewhere has its own traceback, and other texts stay whole."""
    here, there = (f'\nTraceback (most recent call last):\n  File "a.py", line {line}, in step\n' for line in (1, 2))
    failed = [f"a{here}KeyError: 1", f"b{here}KeyError: 2", f"c{there}KeyError: 1", "d\nits log", "e\nits log"]
    assert [*each_trace_once(failed)] == [failed[0], "b", *failed[2:]]
