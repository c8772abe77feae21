"""`deltaswarm why`: whether B could hear A at T, and if not, why not, with the numbers."""

import json
import re
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.inspect.info import ending_text
from deltaswarm_orchestrator.inspect.link_report import LinkFindings, examine
from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from tests.support.airs import EVERYTHING
from tests.support.complaints import Printed
from tests.support.cores import play
from tests.support.tiers import in_one_test

STEPS = 120


def a_scenario(*overrides: str) -> Scenario:
    own = ["record=off", "agents.count=10", "events.rate_hz=0.3", f"run.duration_s={STEPS}"]
    return load_scenario("smoke", [*own, *overrides], seed=3)


def cuts(answer: LinkFindings) -> list[str]:
    return [finding["reason"] for finding in answer.findings if finding["cuts"]]


def numbers(answer: LinkFindings, reason: str) -> dict[str, Any]:
    (found,) = (finding["numbers"] for finding in answer.findings if finding["reason"] == reason)
    return dict(found)


@in_one_test(
    ("radio", "reason"),
    [
        ("radio.range_m=100", None),
        ("radio.range_m=6.01", "range"),
        ("radio.blackouts=[{from_s=30}]", "blackout"),
        ("radio.walls=[{a_m=[-1, 20], b_m=[41, 20.1]}, {a_m=[20, -1], b_m=[20.1, 41]}]", "partition"),
        ("radio.jammers=[{center_m=[20, 20], radius_m=60}]", "jam"),
        ("radio.asymmetry.dead_share=1.0", "asymmetry"),
    ],
)
def test_what_cuts_a_link_is_named(radio: str, reason: str | None) -> None:
    """The first model that cuts it is the reason; what comes after is told, too."""
    scenario = a_scenario("radio.range_m=100", radio)
    answers = [examine(scenario, sender, receiver, 60, []) for sender, receiver in ((0, 1), (2, 3), (4, 5), (6, 7))]
    assert reason in {answer.reason for answer in answers}
    for answer in answers:
        assert answer.reason == next(iter(cuts(answer)), None)
        assert answer.time_s == 60.0
        assert (numbers(answer, "range")["distance_m"] > numbers(answer, "range")["range_m"]) == (
            answer.reason == "range"
        )


def test_path_loss_shows_its_sum() -> None:
    """Received power is what was sent, less the loss, with the shadowing."""
    found = numbers(examine(a_scenario('radio.reception="log-distance"'), 1, 2, 50, []), "range")
    assert found["received_dbm"] == pytest.approx(-found["path_loss_db"] + found["shadowing_db"])
    assert found["path_loss_db"] > 40


def test_what_it_says_of_frames_is_what_happened() -> None:
    """With every model at once, over all pairs, every third step: as many delivered, dropped and waiting as counted."""
    swarm = InProcess(a_scenario(*EVERYTHING))
    pairs = [(sender, receiver) for sender in range(10) for receiver in range(10) if sender != receiver]
    received = 0
    for record in play(swarm, STEPS):
        if record.step % 3:
            continue
        outcomes = [outcome for pair in pairs for outcome in swarm.world.explain(*pair)[1]]
        assert outcomes.count("delivered") == record.frames_received
        kinds = Counter(outcome.removeprefix("dropped: ").split(",")[0] for outcome in outcomes if "dropped" in outcome)
        assert kinds == {reason: count for reason, count in record.frames_dropped.items() if count}
        waiting = sum(outcome.startswith(("under way", "waits")) for outcome in outcomes)
        assert waiting == record.frames_in_flight - 9 * record.frames_sent
        received += record.frames_received
    assert received > 0


def test_a_dead_radio_is_the_reason() -> None:
    """From the step after that in which it dies, since what was sent before is still heard; so for its frames."""
    scenario = a_scenario("radio.range_m=100", 'fault=[{kind="radio-dead", at_s=20, duration_s=20, agents=[0]}]')
    found = {}
    for step in (20, 21, 30, 40, 41):
        for receiver in range(1, 10):
            answer = examine(scenario, 0, receiver, step, [])
            found[step] = answer.reason
            assert (answer.reason == "dead") == (21 <= step <= 40)
            assert all(
                outcome.startswith("dropped: dead" if answer.reason else "delivered") for outcome in answer.outcomes
            )
        assert examine(scenario, 1, 0, step, []).reason == ("dead" if 20 <= step < 40 else None)
    assert set(found.values()) == {None, "dead"}


UPLINK = (
    "uplink.base_m=[5, 5]",
    "uplink.range_m=20",
    "uplink.relay=true",
    "uplink.loss=0.2",
    "uplink.latency_s=3",
    'fault=[{kind="radio-dead", at_s=25, agents=[0]}]',
)


def test_the_operator_is_asked_about_too() -> None:
    """What is said of all agents' reports is what the world counts; each reason has its numbers."""
    scenario = a_scenario(*UPLINK)
    step_records = run_in_process(scenario).step_records
    for step in (30, 50):
        answers = [examine(scenario, agent, "operator", step, step_records) for agent in range(10)]
        outcomes = [outcome for answer in answers for outcome in answer.outcomes]
        record = step_records[step]
        assert outcomes.count("arrived") == record.reports_arrived
        assert outcomes.count("dropped: loss") == record.reports_dropped["loss"]
        assert sum(outcome.startswith("under way") for outcome in outcomes) <= record.reports_in_flight
        assert answers[0].reason == "dead"
        for answer in answers[1:]:
            shown = numbers(answer, "range")
            assert answer.reason == (None if shown["distance_m"] <= 20 or "hops" in shown else "range")
        assert {answer.differs_from_step for answer in answers} == {None}


def test_without_an_uplink_model_the_operator_hears_all(folder: Path, capsys: Printed) -> None:
    """It says so; and what is neither a number nor the operator is a mistake."""
    assert main(["why", str(folder), "1", "operator", "--at", "100"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("At 100 s (step 100) the operator could hear agent 1\nok ")
    assert "uplink" in said
    with pytest.raises(SystemExit) as caught:
        main(["why", str(folder), "1", "operators", "--at", "100"])
    assert caught.value.code == 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "run"
    assert main(["run", "smoke", "--in-process", "--record", "off", "--out", str(out), "--set", "radio.loss=0.2"]) == 0
    return out


def test_a_run_is_asked_by_its_folder(folder: Path, capsys: Printed) -> None:
    """In words, and as JSON; the rows of the run are those of the folder."""
    assert main(["why", str(folder), "1", "2", "--at", "100.5"]) == 0
    said = capsys.readouterr().out
    assert re.match(r".*100 s .*step 100.*agent 2 ", said)
    assert "distance" in said
    assert main(["why", str(folder), "1", "2", "--at", "100.5", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["step"], found["sender"], found["receiver"], found["differs_from_step"]) == (100, 1, 2, None)


def test_the_last_step_is_that_of_the_run_too(folder: Path, tmp_path: Path, capsys: Printed) -> None:
    """All agents are asked in it, which is no disturbance; nor is it in a run that was stopped before its end."""
    assert main(["why", str(folder), "1", "2", "--at", "299"]) == 0
    assert "equals" in capsys.readouterr().out
    rows = [record for record, _ in InProcess(a_scenario("run.duration_s=60")).steps()]
    assert examine(a_scenario(), 1, 2, 80, rows).differs_from_step is None


def test_without_a_link_it_says_how_the_run_ended(folder: Path, capsys: Printed) -> None:
    """What failed, in its order; a link that is asked for in part is a mistake."""
    assert main(["why", str(folder)]) == 0
    assert capsys.readouterr().out.splitlines() == [f"{folder}: complete", "nothing failed"]
    ending = {"folder": "x", "state": "incomplete (failed)", "why": ["agent 3 was", "world was"], "valid": False}
    said = ending_text({**ending, "invalid_because": ["it ended: world was"]})
    assert said.splitlines()[1:] == ["1. agent 3 was", "2. world was", "not valid: it ended: world was"]
    for some in (["1"], ["1", "2"], ["--at", "3"]):
        assert main(["why", str(folder), *some]) == 2
        assert "A, B and --at" in capsys.readouterr().err


def test_a_run_that_was_disturbed_says_so(folder: Path, tmp_path: Path, capsys: Printed) -> None:
    """What another run than this one knows of itself is told, and the exit code is 1; and where it ended too early."""
    for name in ("scenario.toml", "summary.json", "events.csv"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["seal"]
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    rows = (folder / "series.csv").read_text().splitlines()
    cells = rows[51].split(",")
    rows[51] = ",".join([*cells[:2], str(int(cells[2]) - 1), *cells[3:]])
    (tmp_path / "series.csv").write_text("\n".join(rows) + "\n")
    assert main(["why", str(tmp_path), "1", "2", "--at", "40"]) == 0
    assert "equals" in capsys.readouterr().out
    assert main(["why", str(tmp_path), "1", "2", "--at", "60"]) == 1
    said = capsys.readouterr()
    assert "from step 50 on" in said.err
    assert "from step 50 on" in said.out
    assert "equals" not in said.out
    (tmp_path / "series.csv").write_text("\n".join(rows[:41]) + "\n")
    assert main(["why", str(tmp_path), "1", "2", "--at", "60"]) == 0
    assert "40 steps" in capsys.readouterr().out


def test_what_a_person_ordered_is_part_of_the_run(tmp_path: Path, capsys: Printed) -> None:
    """It is in `commands.toml` alone; without it another run would be examined. A branch is none by its scenario."""
    order = 'command=[{at_s=5, name="set delta", arguments={delta=1}}]'
    keys = [word for key in (order, "run.duration_s=60", "events.rate_hz=0.3") for word in ("--set", key)]
    run = tmp_path / "run"
    assert main(["run", "smoke", *keys, "--seed", "1", "--in-process", "-q", "--out", str(run)]) == 0
    scenario, manifest = tomllib.loads((run / "scenario.toml").read_text()), run / "manifest.json"
    (run / "commands.toml").write_text(tomli_w.dumps({"command": scenario.pop("command")}))
    (run / "scenario.toml").write_text(tomli_w.dumps(scenario))
    (run / "wall_times.csv").touch()
    unsealed = {key: value for key, value in json.loads(manifest.read_text()).items() if key != "seal"}
    manifest.write_text(json.dumps(unsealed))
    assert main(["why", str(run), "1", "2", "--at", "50"]) == 0
    assert "equals" in capsys.readouterr().out
    manifest.write_text(json.dumps(unsealed | {"branch": {"parent": {"folder": "first"}}}))
    assert main(["why", str(run), "1", "2", "--at", "50"]) == 2
    assert "no branch" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (["1", "6", "--at", "5"], ["B ", "(got 6)", "0 to 5"]),
        (["2", "2", "--at", "5"], ["B ", "(got 2)"]),
        (["1", "2", "--at", "300"], ["--at ", "(got 300)", "below 300 s"]),
    ],
)
def test_a_wrong_question_ends_with_2(folder: Path, arguments: list[str], facts: list[str], capsys: Printed) -> None:
    """One line names the argument, the value and the limit."""
    assert main(["why", str(folder), *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert all(fact in line for fact in facts), line
