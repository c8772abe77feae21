"""The command `deltaswarm session`: it does what is left, refuses another design, and outlines what is planned."""

import json
from pathlib import Path

import pytest

from deltaswarm_cli import report
from deltaswarm_cli.main import main
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.intents import carry_out
from deltaswarm_orchestrator.base import inputs, seal
from deltaswarm_orchestrator.results.folder_lock import FolderLock
from deltaswarm_orchestrator.results.run_tables import new_manifest
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.operator_settings import Briefing, OperatorSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.techniques import ProbeSettings
from deltaswarm_sessions.plan import order_of
from deltaswarm_sessions.settings import load_session
from deltaswarm_studies.load import load_study
from deltaswarm_wire.checked import SettingsError
from tests.support.complaints import Printed
from tests.support.sessions import FORMS, a_file
from tests.support.tiers import in_one_test


def test_the_sheet_is_prefilled_and_holds_the_run_back() -> None:
    """Without a text of consent too."""
    probes = ProbeSettings(participant="P007", condition="1 A")
    console = Console(Briefing(operator=OperatorSettings(probes=probes)))
    console.start(0.0)
    assert console.pace.hold_step == 0
    sheet = console.hello("run")["session"]["sheet"]
    assert sheet == {"consent": "", "participant": "P007", "condition": "1 A"}
    carry_out(console, json.dumps({**sheet, "type": "sheet", "from": 1, "consent": True}).encode(), 1.0)
    assert console.pace.hold_step == -1


def test_a_study_file_may_hold_a_session(tmp_path: Path) -> None:
    """It makes no other run."""
    file = a_file(tmp_path)
    file.write_text(file.read_text() + "\n[sweep.axes]\nradio.loss = [0.0, 0.5]\n")
    assert len(load_study(str(file)).sweep.variants) == 2
    assert len(load_session(str(file))[0].condition) == 3


def test_a_session_does_all_runs_and_goes_on_after_one_that_was_cut_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the command for runs; what is complete is not done again, and the record says all."""
    done: list[str] = []
    seeds: list[int] = []
    pages: list[tuple[str, str, str, str]] = []

    def pretend(scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        folder = options.out
        seeds.append(scenario.seed)
        assert options.station
        assert options.station.speed == 5.0
        assert options.researcher_page
        pages.append(
            (
                options.station.listen,
                options.station.token,
                options.researcher_page.listen,
                options.researcher_page.token,
            )
        )
        done.append(folder.name)
        folder.mkdir()
        (folder / "scenario.toml").write_text(to_toml(scenario))
        print("the table of a run")
        is_whole = len(done) != 2
        (folder / "summary.json").write_text(json.dumps({"complete": is_whole, "digest": "d"}))
        return 0 if is_whole else 1

    monkeypatch.setattr(report, "run_and_report", pretend)
    command = ["session", str(a_file(tmp_path)), "--participant", "7", "--out", str(tmp_path / "out")]
    command.append("--researcher")
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
    assert done == ["0-training", second, f"{second}-2", f"2-{order[2]}", f"3-{order[3]}"]
    folder = tmp_path / "out" / "participant-007"
    record = json.loads((folder / "session.json").read_text())
    assert record.pop("seal")["files"] == {}, "the pretended runs have no manifest"
    assert printed == {"folder": str(folder), **record}
    assert [run["condition"] for run in record["runs"]] == order
    assert [len(run["attempts"]) for run in record["runs"]] == [1, 2, 1, 1]
    assert len(set(seeds)) == 5, "the repeated run has other arrivals"
    assert main(command) == 0
    assert len(done) == 5
    assert len({*pages[:2]}) == len({*pages[2:]}) == 1, "each page keeps its address through a session"
    assert len({*pages[0]}) == 4


def test_runs_of_another_design_do_not_pass_for_the_planned_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """A changed scenario, seed, consent or order: nothing is done, and all stays as it is."""
    done: list[str] = []

    def pretend(scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        done.append(options.out.name)
        options.out.mkdir()
        (options.out / "scenario.toml").write_text(to_toml(scenario))
        (options.out / "summary.json").write_text(json.dumps({"complete": True, "digest": "d"}))
        return 0

    monkeypatch.setattr(report, "run_and_report", pretend)
    file, consent = a_file(tmp_path, 2), tmp_path / "consent.txt"
    file.write_text(file.read_text().replace("speed = 5.0", "speed = 5.0\nseed = 1"))
    command = ["session", str(file), "--participant", "1", "--out", str(tmp_path / "out")]
    assert main(command) == 0
    assert len(done) == 3
    record = (tmp_path / "out" / "participant-001" / "session.json").read_text()
    for changed, old, new, said in (
        (
            file,
            "run.duration_s=60",
            "run.duration_s=40",
            "0-training/scenario.toml must be as planned",
        ),
        (file, "seed = 1", "seed = 2", "must be"),
        (consent, "stop", "go", "(other values of operator.probes.consent): undo the change of the session's file"),
        (file, 'label = "B"', 'label = "D"', "must be of the runs training, "),
    ):
        before = changed.read_text()
        changed.write_text(before.replace(old, new))
        capsys.readouterr()
        assert main(command) == 2
        assert said in capsys.readouterr().err
        changed.write_text(before)
    assert main(command) == 0
    assert len(done) == 3
    assert (tmp_path / "out" / "participant-001" / "session.json").read_text() == record


def test_a_file_that_changes_between_runs_ends_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """It is named, then and when the session goes on; all runs of a participant are decided by the same files."""
    grid, done = tmp_path / "grid.csv", list[str]()

    def pretend(scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        assert options.inputs is not None
        inputs.check(scenario, options.inputs, starts_python=False)
        done.append(options.out.name)
        options.out.mkdir()
        (options.out / "scenario.toml").write_text(to_toml(scenario))
        (options.out / "summary.json").write_text(json.dumps({"complete": True, "digest": "d"}))
        manifest = new_manifest(scenario, "processes", "off")
        files = seal.digests(options.out, ["scenario.toml", "summary.json"])
        seal.write_sealed(options.out / "manifest.json", manifest, files)
        grid.write_text("2,1\n1,1\n")
        return 0

    monkeypatch.setattr(report, "run_and_report", pretend)
    monkeypatch.chdir(tmp_path)
    grid.write_text("1,1\n1,1\n")
    file = a_file(tmp_path, 2)
    density = '\'events.density={kind="grid",file="grid.csv"}\', '
    file.write_text(file.read_text().replace("set = [", f"set = [{density}"))
    for code in (1, 2):
        assert main(["session", str(file), "--participant", "1", "--out", "out"]) == code
        assert "grid.csv" in capsys.readouterr().err
    assert done == ["0-training"]


def test_a_participant_has_one_session_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """The second one does nothing; that of another participant begins."""
    command = ["session", str(a_file(tmp_path)), "--out", str(tmp_path / "out"), "--participant"]
    folder = tmp_path / "out" / "participant-001"
    folder.mkdir(parents=True)
    monkeypatch.setattr(report, "run_and_report", lambda *_, **__: 1)
    lock = FolderLock(folder)
    assert main([*command, "1"]) == 2
    assert "under way" in capsys.readouterr().err
    assert main([*command, "2"]) == 1
    lock.release()
    assert main([*command, "1"]) == 1


def test_a_session_is_outlined_before_anybody_sits_there(tmp_path: Path, capsys: Printed) -> None:
    """How long it takes, what is asked, and what all runs share; a run's own keys win."""
    file = a_file(tmp_path, 2, FORMS)
    shared = 'set = ["run.duration_s=600", "operator.probes.sagat_at_s=[30]", "operator.task.target_share=0.5"]\n'
    text = file.read_text().replace("[session]\n", f"[session]\n{shared}")
    file.write_text(text.replace('["control.delta=3', '["operator.probes.tlx=true", "control.delta=3'))
    command = ["session", str(file), "--participant", "1", "--out", str(tmp_path / "out"), "--dry-run"]
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [(run["label"], run["simulated_s"], run["wall_min"]) for run in told["runs"]] == [
        ("training", 60.0, 0.2),
        ("A", 600.0, 2.0),
        ("B", 600.0, 2.0),
    ]
    assert told["wall_min"] == pytest.approx(4.2)
    isa = "ISA every 120 to 150 s"
    assert [run["asks"] for run in told["runs"]] == [
        ["SAGAT at 30 s", isa, "task"],
        ["SAGAT at 30 s", isa, "task"],
        ["SAGAT at 30 s", isa, "NASA-TLX", "task"],
    ]
    assert told["forms"]["you"] == "before"
    assert main(command) == 0
    assert "SAGAT at 30 s; ISA every 120 to 150 s; NASA-TLX; task" in capsys.readouterr().out


@in_one_test(
    ("speed", "every_s", "wait_s", "warns"),
    [(5, 120, 20, False), (5, 99, 20, True), (0, 120, 20, True), (0, 0, 1, False)],
)
def test_questions_that_come_too_fast_are_warned_of(speed: float, every_s: float, wait_s: float, warns: bool) -> None:
    """The interval is simulated time, the time to answer wall time."""
    scenario = load_scenario(
        "smoke", [f"operator.probes.isa_every_s={every_s}", f"operator.probes.isa_wait_s={wait_s}"]
    )
    assert bool(report.isa_warning(scenario, speed)) == warns


@pytest.mark.parametrize("probe", ["sagat_at_s", "spam_at_s"])
def test_a_question_after_the_end_is_refused(probe: str) -> None:
    """It would never be asked."""
    load_scenario("smoke", ["run.duration_s=60", f"operator.probes.{probe}=[30, 59]"])
    with pytest.raises(SettingsError, match=rf"operator.probes.{probe} .*60"):
        load_scenario("smoke", ["run.duration_s=60", f"operator.probes.{probe}=[30, 60]"])


def test_a_page_offers_only_orders_that_there_are() -> None:
    """A name that the controller does not know would leave the participant without it, in silence."""
    assert load_scenario("smoke", ['operator.page.orders=["hold", "recall"]']).operator.page.orders == (
        "hold",
        "recall",
    )
    with pytest.raises(SettingsError) as told:
        load_scenario("smoke", ['operator.page.orders=["hold", "recal"]'])
    [problem] = told.value.problems
    assert (problem.path, problem.given) == ("operator.page.orders", "recal")
