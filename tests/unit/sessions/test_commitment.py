"""A plan that is frozen before the study: its hash, what may no longer change, and runs that repeat."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from deltaswarm_cli import report
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.seal import write_sealed
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_scenario.scenario import Scenario
from tests.support.complaints import Printed
from tests.support.sessions import a_command, edited, rows_of

EXCLUDE = "\n[session.exclude]\nmax_answers_missing = 3\n"


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The command for sessions of two short conditions, whose runs have no station."""

    def run(scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        return done(scenario, RunOptions(out=options.out, in_process=True), quiet=True)

    done = report.run_and_report
    monkeypatch.setattr(report, "run_and_report", run)
    command = a_command(tmp_path, 2, EXCLUDE)
    text = Path(command[1]).read_text().replace('set = ["run.duration_s=60"]', "")
    short = 'speed = 5.0\nset = ["run.duration_s=4", "run.step_s=0.5", "operator.probes.isa_every_s=0"]'
    Path(command[1]).write_text(text.replace("speed = 5.0", short))
    return command


def frozen(command: list[str], capsys: Printed) -> str:
    """Freeze, and return the printed hash."""
    assert main([*command, "--freeze"]) == 0
    return str(capsys.readouterr().out.split()[0])


def test_the_hash_commits_to_the_plan_and_shows_nothing(command: list[str], tmp_path: Path, capsys: Printed) -> None:
    """It is the SHA-256 of the file's canonical form; the same plan twice has two hashes."""
    first = frozen(command, capsys)
    entry = json.loads((tmp_path / "out" / "commitment.json").read_text())
    assert (tmp_path / "out" / "commitment.json").stat().st_mode & 0o077 == 0
    assert entry.pop("hash") == first
    text = json.dumps(["session", "", entry], sort_keys=True)
    assert hashlib.sha256(text.encode()).hexdigest() == first
    assert entry["plan"]["session"]["exclude"]["max_answers_missing"] == 3
    assert entry["plan"]["scenario"]["B"]["control.delta"] == 3
    assert main([*command, "--freeze"]) == 2
    other = [*command, "--out", str(tmp_path / "other")]
    assert frozen(other, capsys) != first


def test_sessions_of_another_plan_are_refused(command: list[str], tmp_path: Path, capsys: Printed) -> None:
    """Scenario, exclusions and consent; nothing can be frozen after the first session."""
    frozen(command, capsys)
    for file, old, new, named in (
        (Path(command[1]), "control.delta=3", "control.delta=4", "scenario.B.control.delta"),
        (Path(command[1]), "max_answers_missing = 3", "max_answers_missing = 4", "session.exclude.max_answers_missing"),
        (tmp_path / "consent.txt", "stop", "go", "consent"),
    ):
        before = file.read_text()
        file.write_text(before.replace(old, new))
        assert main([*command, "--participant", "1"]) == 2
        assert named in capsys.readouterr().err
        file.write_text(before)
    assert main([*command, "--participant", "1", "--language", "de", "--dry-run"]) == 0
    late = [*command, "--out", str(tmp_path / "late")]
    assert main([*late, "--participant", "1"]) == 0
    assert main([*late, "--freeze"]) == 2
    assert "before the first session" in capsys.readouterr().err


def test_sessions_are_verified_against_the_hash(command: list[str], tmp_path: Path, capsys: Printed) -> None:
    """Runs repeat to their digests; another hash, another digest, another order and another scenario are named."""
    published, out = frozen(command, capsys), tmp_path / "out"
    assert main([*command, "--participant", "2"]) == 0
    assert main([*command, "--table", str(tmp_path / "data")]) == 0
    assert [row["frozen"] for row in rows_of(tmp_path / "data" / "participants.tsv")] == [published]
    verify = ["verify", str(out), "--against", published]
    capsys.readouterr()
    assert main(verify) == 0
    assert "3 of 3 planned runs are complete" in capsys.readouterr().out
    assert main(["verify", str(out), "--against", "00" * 32]) == 1
    assert "--against must be the hash" in capsys.readouterr().out
    run = out / "participant-002" / "0-training"
    for name, old, new, named in (
        ("summary.json", '"digest": "', '"digest": "0', "the digest must repeat"),
        ("summary.json", '"events_digest": "', '"events_digest": "0', "the events_digest must repeat"),
        ("scenario.toml", "seed = ", "seed = 1", "other values of seed"),
        ("scenario.toml", "step_s = 0.5", "step_s = 1.0", "other values of run.step_s"),
    ):
        before = (run / name).read_text()
        for sealed in (run / "manifest.json", run.parent / "session.json"):
            record = json.loads(sealed.read_text())
            record.pop("seal", None)
            sealed.write_text(json.dumps(record))
        (run / name).write_text(before.replace(old, new, 1))
        assert main(verify) == 1
        assert named in capsys.readouterr().out
        (run / name).write_text(before)
    record["runs"][1]["condition"], record["runs"][2]["condition"] = "X", "Y"
    (run.parent / "session.json").write_text(json.dumps(record))
    assert main(verify) == 1
    assert "by the frozen order (got X)" in capsys.readouterr().out
    edited(out / "commitment.json", date="2026-01-01T00:00:00+00:00")
    assert main(verify) == 2
    assert "was changed or damaged" in capsys.readouterr().err


def test_what_is_missing_or_older_than_the_freeze_is_not_verified(
    command: list[str], tmp_path: Path, capsys: Printed
) -> None:
    """Each is named, and the exit code is not 0; nor is it without any session."""
    early, out = tmp_path / "early", tmp_path / "out"
    assert main([*command, "--out", str(early), "--participant", "1"]) == 0
    capsys.readouterr()
    verify = ["verify", str(out), "--against", frozen(command, capsys)]
    assert main(verify) == 1
    assert "at least one session" in capsys.readouterr().out
    shutil.copytree(early / "participant-001", out / "participant-001")
    assert main([*command, "--participant", "1"]) == 2, "nor does it go on"
    assert main(verify) == 1
    told = capsys.readouterr().out
    assert "participant-001: must be begun under the frozen plan" in told
    assert "0 of 3 planned runs are complete, as planned" in told
    shutil.rmtree(out / "participant-001")
    assert main([*command, "--participant", "2"]) == 0
    assert main(verify) == 0
    kept = tmp_path / "kept"
    shutil.copytree(out, kept)
    here = out / "participant-002"

    record = json.loads((here / "session.json").read_text())
    without, cut_off = (json.loads(json.dumps(record)) for _ in range(2))
    without["runs"][2]["attempts"] = []
    cut_off["runs"][2]["attempts"][0]["complete"] = False

    def without_a_run() -> None:
        shutil.rmtree(here / f"2-{record['runs'][2]['condition']}")
        write_sealed(here / "session.json", without, {})

    early_record = record | {"begun": "2001-01-01T00:00:00+00:00"}
    for change, named in (
        (lambda: shutil.rmtree(here), "participant 2 began, and the folder participant-002 is missing"),
        ((here / "session.json").unlink, "participant-002: session.json is missing"),
        ((out / "roster.json").unlink, "roster.json is missing"),
        (lambda: main([*command, "--withdraw", "2"]), "participant 2 withdrew on"),
        (without_a_run, "planned, and not done"),
        (lambda: write_sealed(here / "session.json", cut_off, {}), "planned, and not complete"),
        (lambda: write_sealed(here / "session.json", early_record, {}), "must be begun after the plan was frozen"),
    ):
        change()
        capsys.readouterr()
        assert main(verify) == 1
        assert named in capsys.readouterr().out
        shutil.rmtree(out)
        shutil.copytree(kept, out)
    shutil.rmtree(here)
    (out / "roster.json").unlink()
    (out / "commitment.json").unlink()
    for option in (["--participant", "3"], ["--withdraw", "3"]):
        assert main([*command, *option]) == 0
    assert main([*command, "--freeze"]) == 2, "somebody began, and withdrew"
