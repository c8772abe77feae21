"""The command `deltaswarm session`: it does what is left, refuses another design, and outlines what is planned."""

import json
from pathlib import Path

import pytest

from deltaswarm_cli import report
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base import inputs, seal
from deltaswarm_orchestrator.results.folder_lock import FolderLock
from deltaswarm_orchestrator.results.run_tables import new_manifest
from deltaswarm_orchestrator.run.operating import question_warning
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_sessions.plan import order_of
from deltaswarm_sessions.settings import load_session
from deltaswarm_studies.load import load_study
from deltaswarm_wire.checked import SettingsError
from tests.support.complaints import Printed
from tests.support.sessions import FORMS, Pretended, a_command, a_file, rows_of, with_criterion
from tests.support.tiers import in_one_test


def test_a_study_file_may_hold_a_session(tmp_path: Path) -> None:
    """It makes no other run."""
    file = a_file(tmp_path)
    file.write_text(file.read_text() + "\n[sweep.axes]\nradio.loss = [0.0, 0.5]\n")
    assert len(load_study(str(file)).sweep.variants) == 2
    assert len(load_session(str(file))[0].condition) == 3


def test_a_session_does_all_runs_and_goes_on_after_one_that_was_cut_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """By the command for runs; what is complete is not done again, and the record says all."""
    runs = Pretended(monkeypatch, {}, {"complete": False})
    command = [*a_command(tmp_path, 3), "--participant", "7"]
    assert main([*command, "--dry-run"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in printed[:5]] == ["run", "training", "A", "B", "C"]
    assert main(command) == 1
    capsys.readouterr()
    assert main([*command, "--dry-run", "--json"]) == 0
    order = [run["label"] for run in json.loads(capsys.readouterr().out)["runs"]]
    assert order == ["training", *("ABC"[index] for index, _ in order_of(7, 3, seed=1))]
    assert main([*command, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    second = f"1-{order[1]}"
    assert runs.done == ["0-training", second, f"{second}-2", f"2-{order[2]}", f"3-{order[3]}"]
    folder = tmp_path / "out" / "participant-007"
    record = json.loads((folder / "session.json").read_text())
    assert record.pop("seal")["files"] == {}, "the pretended runs have no manifest"
    assert printed == {"folder": str(folder), **record}
    assert [run["condition"] for run in record["runs"]] == order
    assert [len(run["attempts"]) for run in record["runs"]] == [1, 2, 1, 1]
    assert len({scenario.seed for scenario in runs.scenarios}) == 5, "the repeated run has other arrivals"
    assert main(command) == 0
    assert len(runs.done) == 5


def test_runs_of_another_design_do_not_pass_for_the_planned_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """A changed scenario, seed, consent or order: nothing is done, and all stays as it is."""
    runs = Pretended(monkeypatch)
    command = [*a_command(tmp_path), "--participant", "1"]
    file, consent = Path(command[1]), tmp_path / "consent.txt"
    file.write_text(file.read_text().replace("speed = 5.0", "speed = 5.0\nseed = 1"))
    assert main(command) == 0
    record = (tmp_path / "out" / "participant-001" / "session.json").read_text()
    for changed, old, new, said in (
        (file, "run.duration_s=60", "run.duration_s=40", "0-training/scenario.toml must be as planned"),
        (file, "seed = 1", "seed = 2", "must be"),
        (file, "control.delta=2", "control.delta=4", "(other values of control.delta"),
        (consent, "stop", "go", "(other values of operator.probes.consent): undo the change of the session's file"),
        (file, 'label = "B"', 'label = "D"', "must be of the runs training, "),
    ):
        before = changed.read_text()
        changed.write_text(before.replace(old, new))
        assert main(command) == 2
        assert said in capsys.readouterr().err
        changed.write_text(before)
    assert main(command) == 0
    assert len(runs.done) == 3
    assert (tmp_path / "out" / "participant-001" / "session.json").read_text() == record


def test_a_file_that_changes_between_runs_ends_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """It is named, then and when the session goes on; all runs of a participant are decided by the same files."""
    grid, runs = tmp_path / "grid.csv", Pretended(monkeypatch)

    def run(scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        assert options.inputs is not None
        inputs.check(scenario, options.inputs, starts_python=False)
        code = runs(scenario, options, quiet=quiet)
        files = seal.digests(options.out, ["scenario.toml", "summary.json"])
        seal.write_sealed(options.out / "manifest.json", new_manifest(scenario, "processes", "off"), files)
        grid.write_text("2,1\n1,1\n")
        return code

    monkeypatch.setattr(report, "run_and_report", run)
    monkeypatch.chdir(tmp_path)
    grid.write_text("1,1\n1,1\n")
    command = [*a_command(tmp_path), "--participant", "1"]
    density = '\'events.density={kind="grid",file="grid.csv"}\', '
    Path(command[1]).write_text(Path(command[1]).read_text().replace("set = [", f"set = [{density}"))
    for code in (1, 2):
        assert main(command) == code
        assert "grid.csv" in capsys.readouterr().err
    assert runs.done == ["0-training"]


def test_a_participant_has_one_session_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """The second one does nothing; that of another participant begins."""
    Pretended(monkeypatch)
    command = [*a_command(tmp_path), "--participant"]
    folder = tmp_path / "out" / "participant-001"
    folder.mkdir(parents=True)
    lock = FolderLock(folder)
    assert main([*command, "1"]) == 2
    assert "under way" in capsys.readouterr().err
    assert main([*command, "2"]) == 0
    lock.release()
    assert main([*command, "1"]) == 0


def test_a_session_is_outlined_before_anybody_sits_there(tmp_path: Path, capsys: Printed) -> None:
    """How long it takes, what is asked, and what all runs share; a run's own keys win."""
    command = [*a_command(tmp_path, 2, FORMS), "--participant", "1", "--dry-run"]
    file = Path(command[1])
    shared = 'set = ["run.duration_s=600", "operator.probes.sagat_at_s=[30]", "operator.task.target_share=0.5"]\n'
    text = file.read_text().replace("[session]\n", f"[session]\n{shared}")
    file.write_text(text.replace('["control.delta=3', '["operator.probes.tlx=true", "control.delta=3'))
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    asked = ["SAGAT at 30 s", "ISA every 120 to 150 s"]
    assert [(run["label"], run["simulated_s"], run["wall_min"], run["asks"]) for run in told["runs"]] == [
        ("training", 60.0, 0.2, [*asked, "task"]),
        ("A", 600.0, 2.0, [*asked, "task"]),
        ("B", 600.0, 2.0, [*asked, "NASA-TLX", "task"]),
    ]
    assert told["wall_min"] == pytest.approx(4.2)
    assert told["forms"]["you"] == "before"
    assert main(command) == 0
    assert "SAGAT at 30 s; ISA every 120 to 150 s; NASA-TLX; task" in capsys.readouterr().out


def tables(command: list[str], folder: Path) -> tuple[dict[str, str], list[dict[str, str]]]:
    """The row of the only participant, and those of the runs."""
    assert main([*command[:4], "--table", str(folder / "data")]) == 0
    [participant] = rows_of(folder / "data" / "participants.tsv")
    return participant, rows_of(folder / "data" / "runs.tsv")


def test_training_is_repeated_until_it_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """With other arrivals; runs that were complete before a cut count, and the runs follow only once it is enough."""
    read = ({"person": {"read": 2}}, {"complete": False}, {"person": {"read": 4}}, {"person": {"read": 6}})
    runs = Pretended(monkeypatch, *read)
    command = [*a_command(tmp_path, 2, with_criterion()), "--participant", "1"]
    names = ("training_runs", "training_outcome", "runs", "complete")
    assert main(command) == 1
    assert [tables(command, tmp_path)[0][name] for name in names] == ["1", "open", "3", "1"]
    assert main(command) == 0
    assert "training again (3 of at most 3), since read must be at least 5 (got 2, 4)" in capsys.readouterr().err
    assert runs.done[:4] == ["0-training", "0-training-2", "0-training-3", "0-training-4"]
    assert [name[0] for name in runs.done[4:]] == ["1", "2"]
    assert len({scenario.seed for scenario in runs.scenarios}) == 6
    assert [bool(scenario.operator.probes.consent) for scenario in runs.scenarios[:4]] == [True, False, False, False]
    participant, rows = tables(command, tmp_path)
    assert [participant[name] for name in names] == ["3", "reached", "3", "3"]
    found = {row["run"]: (row["position"], row["training_value"]) for row in rows}
    assert [found[name] for name in runs.done[:4]] == [("0", "2.0"), ("0", ""), ("0", "4.0"), ("0", "6.0")]
    assert [found[name][1] for name in runs.done[4:]] == ["", ""]
    assert main(command) == 0
    assert len(runs.done) == 6, "nothing is left to do, and the scenarios are as planned"


@pytest.mark.parametrize(("then", "code", "count"), [("go on", 0, 4), ("end", 1, 2)])
def test_a_session_whose_training_is_not_enough(
    then: str, code: int, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """It goes on or ends, as the file says, says so, and marks the participant; the same when it is continued."""
    runs = Pretended(monkeypatch, {"person": {"read": 1}}, {"person": {"read": 2}})
    more = with_criterion(more=f'max_runs = 2\nif_not_reached = "{then}"')
    command = [*a_command(tmp_path, 2, more), "--participant", "1"]
    for _ in range(2):
        assert main(command) == code
        said = "the criterion of the training is not reached: read must be at least 5 (got 1, 2); the session"
        assert said in capsys.readouterr().err
        assert len(runs.done) == count
    participant, _ = tables(command, tmp_path)
    assert (participant["training_runs"], participant["training_outcome"]) == ("2", "not reached")


@in_one_test(
    ("speed", "keys", "warns"),
    [
        (5, ["isa_every_s=120"], ""),
        (5, ["isa_every_s=60"], "4 of 9 would not be asked"),  # each is open for 100 s
        (0, ["isa_every_s=120"], "as fast as possible"),
        (0, ["isa_every_s=0"], ""),
        (1, ["isa_every_s=50", "spam_at_s=[45, 90]"], "isa at 50 s"),
        (1, ["isa_every_s=0", "spam_at_s=[595]", "spam_ready=false"], "cut off by the end"),
    ],
)
def test_questions_that_do_not_fit_are_warned_of(speed: float, keys: list[str], warns: str) -> None:
    """Times of questions are simulated, the time to answer passes by the wall clock."""
    scenario = load_scenario("smoke", ["run.duration_s=600", *(f"operator.probes.{key}" for key in keys)])
    warning = question_warning(scenario, speed)
    assert bool(warning) == bool(warns)
    assert warns in (warning or "")


@in_one_test(
    ("good", "bad", "path"),
    [
        ("operator.probes.sagat_at_s=[30, 59]", "operator.probes.sagat_at_s=[30, 60]", "operator.probes.sagat_at_s"),
        ("operator.probes.spam_at_s=[30, 59]", "operator.probes.spam_at_s=[30, 60]", "operator.probes.spam_at_s"),
        ('operator.page.orders=["recall"]', 'operator.page.orders=["recal"]', "operator.page.orders"),
    ],
)
def test_what_would_never_be_asked_or_offered_is_refused(good: str, bad: str, path: str) -> None:
    """A question after the end, and an order that the controller does not know."""
    load_scenario("smoke", ["run.duration_s=60", good])
    with pytest.raises(SettingsError) as told:
        load_scenario("smoke", ["run.duration_s=60", bad])
    assert [problem.path for problem in told.value.problems] == [path]
