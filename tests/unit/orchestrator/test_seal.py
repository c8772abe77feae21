"""Seals: a changed, missing or foreign file is named by every command that reads it, and says what to do."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.seal import SealError

Printed = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two runs of different seeds, whose step is not 1 s."""
    folder = tmp_path_factory.mktemp("runs")
    sets = ["--set", "run.duration_s=20", "--set", "run.step_s=0.5"]
    for seed in ("1", "2"):
        assert main(["run", "smoke", "--in-process", "-q", "--seed", seed, *sets, "--out", str(folder / seed)]) == 0
    return folder


@pytest.fixture
def run(runs: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(runs / "1", tmp_path / "run"))


def edited(file: Path) -> None:
    """One digit of the last line becomes another."""
    text = file.read_text()
    place = max(text.rfind(digit) for digit in "123456789")
    file.write_text(text[:place] + ("7" if text[place] != "7" else "3") + text[place + 1 :])


def cut_off(file: Path) -> None:
    """The second half is missing."""
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


@pytest.mark.parametrize("change", [edited, cut_off, Path.unlink])
@pytest.mark.parametrize("name", ["series.csv", "events.csv", "summary.json", "scenario.toml"])
@pytest.mark.parametrize("command", ["info {}", "why {} 0 1 --at 3", "replay {}"])
def test_a_file_that_changed_after_the_run_is_named(
    command: str, name: str, change: Callable[[Path], None], run: Path, capsys: Printed
) -> None:
    """With exit code 2, in a line that says what differs and what to do."""
    change(run / name)
    assert main(command.format(run).split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert name in line
    assert "restore what was written, or delete" in line or (name, change) == ("scenario.toml", Path.unlink)


@pytest.mark.parametrize("key", ["seed", "digest", "code", "started"])
@pytest.mark.parametrize("command", ["info {}", "replay {}", "export {} --format csv", "export {} --format mcap"])
def test_an_edited_manifest_is_refused(command: str, key: str, run: Path, capsys: Printed) -> None:
    manifest = json.loads((run / "manifest.json").read_text())
    (run / "manifest.json").write_text(json.dumps(manifest | {key: "0"}))
    assert main(command.format(run).split()) == 2
    assert "manifest.json was changed or damaged" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["replay {}", "export {} --format csv", "export {} --format mcap"])
@pytest.mark.parametrize("has_seal", [True, False])
def test_the_recording_of_another_run_is_refused(
    command: str, has_seal: bool, run: Path, runs: Path, capsys: Printed
) -> None:
    shutil.copy(runs / "2" / "recording.mcap", run)
    if not has_seal:
        without_seal(run / "manifest.json")
    assert main(command.format(run).split()) == 2
    assert "must be the recording of the run in" in capsys.readouterr().err


def without_seal(file: Path) -> None:
    """Do what the message about a changed file advises."""
    record = json.loads(file.read_text())
    del record["seal"]
    file.write_text(json.dumps(record))


def test_who_changes_a_file_on_purpose_goes_on_without_a_seal(run: Path, capsys: Printed) -> None:
    """Then every reader says that nothing vouches for the files."""
    edited(run / "series.csv")
    without_seal(run / "manifest.json")
    assert main(["info", str(run)]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["not", "sealed", "events.csv,", "scenario.toml,", "series.csv,", "summary.json"] in rows
    main(["why", str(run), "0", "1", "--at", "3"])
    assert "not sealed, so nobody can tell" in capsys.readouterr().err


def test_a_new_file_in_the_folder_is_nobodys_business(run: Path, capsys: Printed) -> None:
    """Notes of a person; but `info` says that they are not sealed."""
    (run / "notes.txt").write_text("good run")
    assert main(["info", str(run)]) == 0
    assert ["not", "sealed", "notes.txt"] in [line.split() for line in capsys.readouterr().out.splitlines()]


@pytest.mark.parametrize("content", [{"a": 1}, {"ü": [1e300, -0.0, None, True]}, {"big": 2**70, "": {}}])
def test_a_record_is_whole_after_it_was_read(content: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("a\n1\n")
    file = tmp_path / "seal.json"
    seal.write_sealed(file, content, seal.digests(tmp_path, ["table.csv"]))
    record = seal.checked(file)
    assert {name: value for name, value in record.items() if name != "seal"} == content
    file.write_text(json.dumps(record, indent=7))
    assert seal.checked(file) == record
    assert seal.files_of(record) == {"table.csv": [4, seal.digest_of(b"a\n1\n")[1]]}


@pytest.mark.parametrize("wrong", ["seal", {"files": 3}, {"files": {}}, {"files": {}, "sha256": "00"}, None])
def test_a_broken_seal_is_no_missing_seal(wrong: Any, tmp_path: Path) -> None:
    (tmp_path / "seal.json").write_text(json.dumps({"a": 1, "seal": wrong}))
    with pytest.raises(SealError, match="changed or damaged"):
        seal.read_sealed(tmp_path / "seal.json")


def test_a_copy_of_a_table_may_be_missing(tmp_path: Path) -> None:
    """A Parquet file, beside the CSV file; but not changed, and not without it."""
    for name in ("t.csv", "t.parquet"):
        (tmp_path / name).write_text(name)
    seal.write_sealed(tmp_path / "seal.json", {}, seal.digests(tmp_path, ["t.csv", "t.parquet"]))
    (tmp_path / "t.parquet").write_text("other")
    with pytest.raises(SealError, match=r"t\.parquet has 5 bytes instead of 9"):
        seal.checked(tmp_path / "seal.json")
    (tmp_path / "t.parquet").unlink()
    seal.checked(tmp_path / "seal.json")
    (tmp_path / "t.csv").unlink()
    with pytest.raises(SealError, match=r"t\.csv is missing; .*t\.parquet is missing"):
        seal.checked(tmp_path / "seal.json")
