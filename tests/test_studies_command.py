"""`deltaswarm study` and `deltaswarm report` with real runs, as somebody with a question of their own uses them."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_orchestrator.cli import main
from tests.studying import OWN

FINDING = "Loss is no matter to those who do not listen."

QUESTION = """
schema = 1
name = "own"
base = "smoke"
scenario.run.duration_s = 100.0

[sweep]
repeats = 7
prove = 0
series_every_s = 50.0

[sweep.axes]
radio.loss = [0.0, 0.9]

[[sweep.paired]]
label = ["decentralised", "potential"]
control.mode = ["decentralised", "potential"]
""" + OWN.replace("100.0", "50.0") + """
[[contrast]]
id = "limit"
text = "Loss against no loss"
factor = "loss"
reference = "loss=0.0"

[[claim]]
id = "alike"
text = "Decentralised swarms report as much with loss as without"
kind = "alike"
metric = "messages"
a = "loss=0.0, decentralised"
b = "loss=0.9, decentralised"
margin = 1.5

[[figure]]
name = "waiting"
x = "mode"
hue = "loss"
metric = "waiting_all"
caption = "Waiting."

[[finding]]
text = "Loss is no matter to those who do not listen."
because = [{ claim = "alike", is = "holds" }]
"""  # fmt: skip

Printed = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a study that was done."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "own.toml").write_text(QUESTION)
    assert main(["study", str(folder / "own.toml"), "--out", str(folder / "out")]) == 0
    return folder


def test_a_question_becomes_a_page(done: Path) -> None:
    """With verdicts, figures, tables and the finding that the runs carry; two controllers and a limit."""
    page = (done / "out" / "page.md").read_text()
    assert FINDING in page
    claims = pd.read_csv(done / "out" / "claims.csv")
    assert claims["verdict"].tolist() == ["holds"]
    runs = pd.read_csv(done / "out" / "runs.csv")
    assert len(runs) == 28
    assert {f"waiting.{kind}" for kind in ("png", "svg", "pdf")} <= {
        file.name for file in (done / "out/figures").iterdir()
    }


def test_it_is_rendered_again_without_a_run(done: Path, capsys: Printed) -> None:
    """The same page from the same tables, even where the sweep is gone."""
    command = ["study", str(done / "own.toml"), "--out", str(done / "out"), "--render", "--json"]
    before = (done / "out" / "page.html").read_bytes()
    (done / "out" / "sweep").rename(done / "elsewhere")
    try:
        assert main(command) == 0
    finally:
        (done / "elsewhere").rename(done / "out" / "sweep")
    assert json.loads(capsys.readouterr().out)["claims"] == [{"claim": "alike", "verdict": "holds"}]
    assert (done / "out" / "page.html").read_bytes() == before


def test_tables_without_a_metric_of_the_study_are_refused(done: Path, capsys: Printed) -> None:
    """As after the study file has gained one: only the sweep has it."""
    (done / "more.toml").write_text(QUESTION.replace("metrics = [", 'metrics = ["trees", ', 1))
    assert main(["study", str(done / "more.toml"), "--out", str(done / "out"), "--render"]) == 1
    assert "trees" in capsys.readouterr().err


def test_a_finding_that_is_not_carried_fails_the_build(done: Path, capsys: Printed) -> None:
    """Exit code 3, and the sentence is named."""
    (done / "wrong.toml").write_text(QUESTION.replace('is = "holds"', 'is = "refuted"'))
    assert main(["study", str(done / "wrong.toml"), "--out", str(done / "out"), "--render"]) == 3
    assert FINDING in capsys.readouterr().err
    assert main(["study", str(done / "own.toml"), "--out", str(done / "out"), "--render"]) == 0


def test_a_claim_refuted_against_expectation_fails_the_build(done: Path, capsys: Printed) -> None:
    """Exit code 3; expected to be refuted, it does not."""
    text = "It waits for ever"
    value = 'kind = "value"\nmetric = "waiting_all"\nof = "loss=0.0, decentralised"\nwithin = [9000.0, 9001.0]\n'
    for expect, code in (("holds", 3), ("refuted", 0)):
        claim = f'[[claim]]\nid = "v"\ntext = "{text}"\nexpect = "{expect}"\n{value}\n[[figure]]'
        (done / "value.toml").write_text(QUESTION.replace("[[figure]]", claim))
        assert main(["study", str(done / "value.toml"), "--out", str(done / "out"), "--render"]) == code
    assert text in capsys.readouterr().err


def test_studies_share_the_runs_that_they_have_in_common(done: Path, capsys: Printed) -> None:
    """A second study beside the first takes what it needs from it."""
    (done / "other.toml").write_text(QUESTION.replace('"own"', '"other"'))
    assert main(["study", str(done / "other.toml"), "--out", str(done / "other")]) == 0
    assert "28 runs are taken" in capsys.readouterr().err


def test_a_bare_sweep_gets_all_that_a_study_has(done: Path, capsys: Printed) -> None:
    """Contrasts of every factor, figures, a page; another reference and further metrics if asked for."""
    sweep = str(done / "out" / "sweep")
    command = [
        "report",
        sweep,
        "--out",
        str(done / "report"),
        "--metric",
        "samples_rejected",
        "--reference",
        "loss=0.9",
    ]
    assert main([*command, "--json"]) == 0
    assert str(done / "report" / "page.html") in json.loads(capsys.readouterr().out)
    contrasts = pd.read_csv(done / "report" / "contrasts.csv")
    assert {"loss", "mode"} == set(contrasts["contrast"])
    assert set(contrasts[contrasts["contrast"] == "loss"]["reference"]) == {"loss=0.9"}
    assert "samples_rejected" in set(contrasts["metric"])


@pytest.mark.parametrize("wrong", [["--reference", "loss=0.7"], ["--metric", "no_such_column"]])
def test_a_report_names_what_is_not_there(done: Path, wrong: list[str], capsys: Printed) -> None:
    """With exit code 2."""
    assert main(["report", str(done / "out" / "sweep"), *wrong]) == 2
    assert wrong[1] in capsys.readouterr().err


@pytest.mark.parametrize(("name", "content"), [("table.csv", "a,b\n1,2\n"), ("manifest.json", '{"swept": []}')])
def test_a_report_of_a_damaged_sweep_says_so(
    done: Path, name: str, content: str, tmp_path: Path, capsys: Printed
) -> None:
    """With exit code 2, instead of a traceback."""
    damaged = shutil.copytree(done / "out" / "sweep", tmp_path / "sweep")
    (damaged / name).write_text(content)
    assert main(["report", str(damaged)]) == 2
    assert name.partition(".")[0] in capsys.readouterr().err


@pytest.mark.parametrize("name", ["runs.csv", "provenance.csv"])
def test_a_study_with_a_damaged_table_says_so(done: Path, name: str, tmp_path: Path, capsys: Printed) -> None:
    """With exit code 1, instead of a traceback."""
    damaged = shutil.copytree(done / "out", tmp_path / "out", ignore=shutil.ignore_patterns("sweep"))
    (damaged / name).write_text("a,b\n1,2\n")
    assert main(["study", str(done / "own.toml"), "--out", str(damaged), "--render"]) == 1
    assert name in capsys.readouterr().err


def test_what_is_no_study_is_said(tmp_path: Path, capsys: Printed) -> None:
    """A name that is not known, a folder without tables."""
    assert main(["study", "papre"]) == 2
    assert "papre" in capsys.readouterr().err
    assert main(["study", "paper", "--render", "--out", str(tmp_path)]) == 1
    assert "runs.csv" in capsys.readouterr().err


def test_the_table_has_the_same_columns_whatever_the_swarm_is(done: Path) -> None:
    """What is counted for each sender stands in a table of its own; code and commit stand beside each run."""
    table = pd.read_csv(done / "out" / "sweep" / "table.csv")
    assert not [column for column in table if "per_sender" in column or "by_agent" in column]
    assert table["code"].nunique() == 1
    assert "commit" in table
    senders = pd.read_csv(done / "out" / "sweep" / "senders.csv")
    assert {"variant", "replicate", "sender", "name", "value"} <= set(senders)
    assert senders["sender"].nunique() == 6
