"""The page on sessions: its code reads the tables, and its model finds an effect that is in them."""

import json
import re
import shlex
import tomllib
from pathlib import Path
from random import Random

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_sessions.folder import RECORD
from deltaswarm_sessions.plan import order_of, plan
from deltaswarm_sessions.settings import load_session
from deltaswarm_wire.checked import load
from tests.support.pages import ROOT, commands

PAGE = (ROOT / "docs" / "SESSION.md").read_text()
EFFECT, PARTICIPANTS = 10.0, 12


def a_study(out: Path, rng: Random) -> None:
    """Condition B raises the workload by 10; people and streams of arrivals differ, and so does each answer."""
    streams = [rng.gauss(0, 5) for _ in range(2)]
    for participant in range(1, PARTICIPANTS + 1):
        person = rng.gauss(40, 10)
        folder = out / f"participant-{participant:03}"
        runs = []
        for place, (condition, stream) in enumerate(order_of(participant, 2, seed=1), 1):
            label = "AB"[condition]
            workload = person + EFFECT * condition + streams[stream] + rng.gauss(0, 2)
            summary = {"complete": True, "valid": True, "waiting_time_s": {"restricted_mean": 20.0}}
            run = folder / f"{place}-{label}"
            run.mkdir(parents=True)
            (run / "summary.json").write_text(json.dumps({**summary, "person": {"tlx": {"raw": workload}, "isa": 3.0}}))
            asked = ("you", "trust", "trust"), ("age", "reliable", "why"), ("30", "6", "It was quick.")
            rows = [ProbeRow(probe, 0, item, value, 60.0, None) for probe, item, value in zip(*asked, strict=True)]
            write_csv(run / "probes.csv", ProbeRow._fields, rows)
            attempt = {"folder": run.name, "complete": True, "valid": True, "answers_missing": 0}
            runs.append({"place": place, "condition": label, "stream": stream, "attempts": [attempt]})
        (folder / RECORD).write_text(json.dumps({"participant": participant, "runs": runs}))


def test_the_model_of_the_page_finds_the_effect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within three standard errors, and no effect of what has none."""
    a_study(tmp_path / "sessions" / "deltas", Random(4))
    monkeypatch.chdir(tmp_path)
    Path("deltas.toml").write_text("".join(re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)))
    [command] = re.findall(r"^`deltaswarm (session .*--table.*)`$", PAGE, re.MULTILINE)
    assert main(command.split()) == 0
    code = "".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL))
    found: dict[str, object] = {}
    exec(code.replace("print(smf", "model = (smf").replace(".summary())", ")"), found)
    model, runs = found["model"], found["runs"]
    assert set(runs.reliable) == {6}  # type: ignore[attr-defined]
    effect, error = (getattr(model, name)["C(condition)[T.B]"] for name in ("params", "bse"))
    assert error < 3.0
    assert abs(effect - EFFECT) < 3 * error
    position, its_error = (getattr(model, name)["position"] for name in ("params", "bse"))
    assert abs(position) < 3 * its_error


def test_the_plan_of_the_page_fits_its_effect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of 12 participants who differ as they do here, one group is not enough for half of their effect."""
    a_study(tmp_path / "sessions" / "deltas" / "pilot", Random(4))
    monkeypatch.chdir(tmp_path)
    Path("deltas.toml").write_text("".join(re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)))
    for command in commands(PAGE):
        assert main(shlex.split(command)[1:]) == 0
    last, power, _ = capsys.readouterr().out.splitlines()[-1].split()
    assert int(last) % 4 == 0
    assert int(last) > 4
    assert float(power) >= 0.8


def test_the_session_of_the_page_can_be_planned(tmp_path: Path) -> None:
    """With its forms, each in the runs that it belongs to."""
    (tmp_path / "deltas.toml").write_text("".join(re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)))
    (tmp_path / "consent.txt").write_text("You may stop at any time.")
    planned = plan(load_session(str(tmp_path / "deltas.toml"))[0], 1, tmp_path)
    forms = [[form.name for form in run.scenario.operator.probes.form] for run in planned]
    assert forms == [["instructions", "you"], ["trust"], ["trust"]]


def test_the_forms_of_the_station_page_are_a_scenario() -> None:
    [text] = re.findall(r"```toml\n(\[\[.*?)```", (ROOT / "docs" / "STATION.md").read_text(), re.DOTALL)
    scenario = load(Scenario, {"name": "forms", **tomllib.loads(text)})
    assert [question.name for question in scenario.operator.probes.form[0].question] == ["reliable", "why"]
