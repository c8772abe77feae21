"""Training until it is enough: what becomes of a session, and of its tables, when the training is repeated or ends."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_cli import report
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_scenario.scenario import Scenario
from tests.support.complaints import Printed
from tests.support.sessions import a_file, with_criterion


class Runs:
    """Stands for the command for runs: how many items the person reads in each; None: the run is cut off."""

    def __init__(self, *read: int | None) -> None:
        self.read = list(read)
        self.done: list[str] = []
        self.seeds: list[int] = []
        self.consents: list[bool] = []

    def __call__(self, scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        """Do a run."""
        read = self.read.pop(0) if self.read else 0
        self.done.append(options.out.name)
        self.seeds.append(scenario.seed)
        self.consents.append(bool(scenario.operator.probes.consent))
        options.out.mkdir()
        (options.out / "scenario.toml").write_text(to_toml(scenario))
        summary = {"complete": read is not None, "digest": "d", "person": {"read": read, "answers_missing": 0}}
        (options.out / "summary.json").write_text(json.dumps(summary))
        return 0 if read is not None else 1


def tables(file: Path, folder: Path) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """The row of the only participant, and those of the runs."""
    data = folder / "data"
    assert main(["session", str(file), "--out", str(folder / "out"), "--table", str(data)]) == 0
    rows = {}
    for name in ("participants", "runs"):
        with (data / f"{name}.tsv").open(newline="") as stream:
            rows[name] = list(csv.DictReader(stream, delimiter="\t"))
    return rows["participants"][0], rows["runs"]


def test_training_is_repeated_until_it_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """With other arrivals; runs that were complete before a cut count, and the runs follow only once it is enough."""
    runs = Runs(2, None, 4, 6)
    monkeypatch.setattr(report, "run_and_report", runs)
    file = a_file(tmp_path, 2, with_criterion())
    command = ["session", str(file), "--participant", "1", "--out", str(tmp_path / "out")]
    assert main(command) == 1
    participant, _ = tables(file, tmp_path)
    assert (participant["training_runs"], participant["training_outcome"], participant["complete"]) == (
        "1",
        "open",
        "1",
    )
    capsys.readouterr()
    assert main(command) == 0
    assert "training again (3 of at most 3), since read must be at least 5 (got 2, 4)" in capsys.readouterr().err
    trainings = ["0-training", "0-training-2", "0-training-3", "0-training-4"]
    assert runs.done[:4] == trainings
    assert [name[0] for name in runs.done[4:]] == ["1", "2"]
    assert len(set(runs.seeds)) == 6
    assert runs.consents[:4] == [True, False, False, False]
    participant, rows = tables(file, tmp_path)
    assert (participant["training_runs"], participant["training_outcome"]) == ("3", "reached")
    assert (participant["runs"], participant["complete"]) == ("3", "3")
    found = {row["run"]: (row["position"], row["training_value"]) for row in rows}
    assert [found[name] for name in trainings] == [("0", "2.0"), ("0", ""), ("0", "4.0"), ("0", "6.0")]
    assert [found[name][1] for name in runs.done[4:]] == ["", ""]
    assert main(command) == 0
    assert len(runs.done) == 6, "nothing is left to do, and the scenarios are as planned"


@pytest.mark.parametrize(("then", "code", "count"), [("go on", 0, 4), ("end", 1, 2)])
def test_a_session_whose_training_is_not_enough(
    then: str, code: int, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """It goes on or ends, as the file says, says so, and marks the participant; the same when it is continued."""
    runs = Runs(1, 2)
    monkeypatch.setattr(report, "run_and_report", runs)
    file = a_file(tmp_path, 2, with_criterion(more=f'max_runs = 2\nif_not_reached = "{then}"'))
    command = ["session", str(file), "--participant", "1", "--out", str(tmp_path / "out")]
    for _ in range(2):
        assert main(command) == code
        said = "the criterion of the training is not reached: read must be at least 5 (got 1, 2); the session"
        assert said in capsys.readouterr().err
        assert len(runs.done) == count
    participant, _ = tables(file, tmp_path)
    assert (participant["training_runs"], participant["training_outcome"]) == ("2", "not reached")
