"""`deltaswarm study` and `deltaswarm report` with real runs, as somebody with a question of their own uses them."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base import provenance, seal
from tests.support.studying import OWN

FINDING = "- **Loss**\n  - Messages to the operator are"

QUESTION = """
schema = 1
name = "own"
base = "smoke"
scenario.run.duration_s = 100.0
scenario.metrics.horizon_s = 50.0

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
heading = "Loss"
results = [{ claim = "alike" }]
"""  # fmt: skip

Printed = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    (folder / "own.toml").write_text(QUESTION)
    assert main(["study", str(folder / "own.toml"), "--out", str(folder / "out")]) == 0
    return folder


def test_a_question_becomes_a_page(done: Path) -> None:
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
    command = ["study", str(done / "own.toml"), "--out", str(done / "out"), "--render", "--json"]
    before = (done / "out" / "page.html").read_bytes()
    (done / "out" / "sweep").rename(done / "elsewhere")
    try:
        assert main(command) == 0
    finally:
        (done / "elsewhere").rename(done / "out" / "sweep")
    assert json.loads(capsys.readouterr().out)["claims"] == [{"claim": "alike", "verdict": "holds"}]
    assert (done / "out" / "page.html").read_bytes() == before


def test_a_page_says_that_compared_runs_saw_the_same_arrivals(done: Path) -> None:
    page = (done / "out" / "page.md").read_text()
    assert "number and times of arrivals are the same in 21 of 21 pairs of runs" in page
    assert "places of arrivals are the same in 21 of 21 pairs of runs" in page


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("metrics = [", 'metrics = ["trees", '), "trees"),
        (("repeats = 7", "repeats = 9"), "8 of 36 runs are missing: loss=0.0, decentralised (replicates 7 to 8)"),
        (("radio.loss = [0.0, 0.9]", "radio.loss = [0.0, 0.9, 0.5]"), "14 of 42 runs are missing"),
    ],
)
def test_what_tables_lack_stands_at_the_top_of_the_page(
    done: Path, more: tuple[str, str], told: str, tmp_path: Path, capsys: Printed
) -> None:
    """As after the study file has gained a metric, replicates or variants: the page is made, with exit code 1."""
    tables = shutil.copytree(done / "out", tmp_path / "out", ignore=shutil.ignore_patterns("sweep"))
    (tmp_path / "more.toml").write_text(QUESTION.replace(*more, 1))
    assert main(["study", str(tmp_path / "more.toml"), "--out", str(tables), "--render"]) == 1
    assert told in capsys.readouterr().err
    assert told in (tables / "page.md").read_text().partition("## ")[0]


def test_a_figure_that_cannot_be_drawn_is_named_last(done: Path, tmp_path: Path, capsys: Printed) -> None:
    tables = shutil.copytree(done / "out", tmp_path / "out", ignore=shutil.ignore_patterns("sweep"))
    (tables / "seal.json").unlink()
    runs = pd.read_csv(tables / "runs.csv")
    runs.assign(waiting_all=float("nan")).to_csv(tables / "runs.csv", index=False)
    assert main(["study", str(done / "own.toml"), "--out", str(tables), "--render"]) == 1
    assert "The figure 'waiting' is missing" in capsys.readouterr().err


@pytest.mark.usefixtures("checked_by_python")
def test_a_published_run_is_repeated_and_compared(done: Path, tmp_path: Path, capsys: Printed) -> None:
    """Exit code 0 if every number is the same, 3 if one differs in its last digit, 1 without tables."""
    command = ["study", str(done / "own.toml"), "--check", "3", "--seed", "5", "--json", "--out"]
    assert main([*command, str(done / "out")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["repeated"], told["equal"], told["rows"], told["seed"], told["differing"]) == (3, 3, 28, 5, [])
    tables = shutil.copytree(done / "out", tmp_path / "out", ignore=shutil.ignore_patterns("sweep"))
    (tables / "seal.json").unlink()
    runs = pd.read_csv(tables / "runs.csv")
    runs.assign(messages=runs["messages"] * (1 + 1e-15)).to_csv(tables / "runs.csv", index=False)
    assert main([*command, str(tables)]) == 3
    told = json.loads(capsys.readouterr().out)
    assert told["equal"] == 0
    assert {row["metric"] for row in told["differing"]} == {"messages"}
    assert main([*command, str(tmp_path / "nowhere")]) == 1
    assert "runs.csv" in capsys.readouterr().err


def test_a_claim_refuted_against_expectation_fails_the_build(done: Path, capsys: Printed) -> None:
    text = "It waits for ever"
    value = 'kind = "value"\nmetric = "waiting_all"\nof = "loss=0.0, decentralised"\nwithin = [49.9, 50.0]\n'
    for expect, code in (("holds", 3), ("refuted", 0)):
        claim = f'[[claim]]\nid = "v"\ntext = "{text}"\nexpect = "{expect}"\n{value}\n[[figure]]'
        (done / "value.toml").write_text(QUESTION.replace("[[figure]]", claim))
        assert main(["study", str(done / "value.toml"), "--out", str(done / "out"), "--render"]) == code
    assert text in capsys.readouterr().err


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
    assert main(["report", str(done / "out" / "sweep"), *wrong]) == 2
    assert wrong[1] in capsys.readouterr().err


@pytest.mark.parametrize(("name", "content"), [("table.csv", "a,b\n1,2\n"), ("manifest.json", '{"swept": []}')])
def test_a_report_of_a_damaged_sweep_says_so(
    done: Path, name: str, content: str, tmp_path: Path, capsys: Printed
) -> None:
    damaged = shutil.copytree(done / "out" / "sweep", tmp_path / "sweep")
    (damaged / name).write_text(content)
    assert main(["report", str(damaged)]) == 2
    assert name.partition(".")[0] in capsys.readouterr().err


def test_a_report_of_a_sweep_with_missing_runs_says_so(done: Path, tmp_path: Path, capsys: Printed) -> None:
    sweep = shutil.copytree(done / "out" / "sweep", tmp_path / "sweep")
    seal.write_sealed(sweep / "manifest.json", json.loads((sweep / "manifest.json").read_text()), {})
    table = pd.read_csv(sweep / "table.csv", dtype=str)
    table.drop(index=[0, 5]).to_csv(sweep / "table.csv", index=False)
    assert main(["report", str(sweep)]) == 1
    assert "2 of 28 runs are missing" in capsys.readouterr().err
    assert "2 of 28 runs are missing" in (sweep / "page.md").read_text().partition("## ")[0]


@pytest.mark.parametrize("name", ["runs.csv", "provenance.csv"])
def test_a_study_with_a_damaged_table_says_so(done: Path, name: str, tmp_path: Path, capsys: Printed) -> None:
    damaged = shutil.copytree(done / "out", tmp_path / "out", ignore=shutil.ignore_patterns("sweep"))
    (damaged / name).write_text("a,b\n1,2\n")
    (damaged / "seal.json").unlink()
    assert main(["study", str(done / "own.toml"), "--out", str(damaged), "--render"]) == 1
    assert name in capsys.readouterr().err


@pytest.mark.parametrize(
    ("what", "name"),
    [
        *(("--render", name) for name in ("runs.csv", "runs.parquet", "provenance.csv", "estimates.csv", "seal.json")),
        ("--check", "runs.csv"),
    ],
)
def test_an_edited_table_of_a_study_is_not_published(
    done: Path, name: str, what: str, tmp_path: Path, capsys: Printed
) -> None:
    folder = shutil.copytree(done / "out", tmp_path / "out", ignore=shutil.ignore_patterns("sweep"))
    data = (folder / name).read_bytes()
    place = max(data.rfind(digit) for digit in (b"1", b"2", b"4"))
    (folder / name).write_bytes(data[:place] + b"7" + data[place + 1 :])
    command = ["study", str(done / "own.toml"), "--out", str(folder)]
    page = (folder / "page.md").read_bytes()
    assert main([*command, what]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert name in line
    assert "seal.json" in line
    assert (folder / "page.md").read_bytes() == page
    (folder / "seal.json").unlink()
    if (what, name) == ("--render", "estimates.csv"):  # made from the runs again
        assert main([*command, what]) == 0
        assert "not sealed" in capsys.readouterr().err
        assert "not sealed: not known whether they have changed" in (folder / "page.md").read_text()
        assert not (folder / "seal.json").exists(), "what was not sealed must not get a seal by being read"


def test_what_is_no_study_is_said(tmp_path: Path, capsys: Printed) -> None:
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


FAILING = """
from deltaswarm_agent.controllers.potential import PotentialController, PotentialSettings


class Failing(PotentialController):
    Settings = PotentialSettings

    def __init__(self, context):
        super().__init__(context)
        self._agent = context.agent

    def step(self, percept):
        if self._agent == 2 and percept.step == 5:
            raise ValueError("the map is empty")
        return super().step(percept)
"""


def test_a_variant_whose_agent_raises_is_named_and_not_judged(
    tmp_path: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the first line of the page and the last of the command, with one cause; also of a page that is made again."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "failing_agent.py").write_text(FAILING)
    question = QUESTION.replace('"potential"]\n', '"failing_agent:Failing"]\n', 2).replace(
        'label = ["decentralised", "failing_agent:Failing"]', 'label = ["decentralised", "potential"]'
    )
    question = question.replace(', decentralised"\nb =', ', potential"\nb =').replace("repeats = 7", "repeats = 2")
    (tmp_path / "own.toml").write_text(question)
    command = ["study", str(tmp_path / "own.toml"), "--out", str(tmp_path / "out")]
    said = (
        "4 of 8 runs failed or are not valid, and are no replicates: loss=0.0, potential (replicates 0 to 1); "
        "loss=0.9, potential (replicates 0 to 1). For example loss=0.0, potential, replicate 0: not valid: "
        "agent 2 failed in step 5 (95 steps missed): controller failing_agent:Failing failed in step 5: "
        f"ValueError: the map is empty ({tmp_path / 'failing_agent.py'}:14)"
    )
    for more in ([], ["--render"]):
        assert main([*command, *more]) == 1
        printed = capsys.readouterr()
        assert f"deltaswarm: own: {said}" in printed.err
        assert "no data    Decentralised swarms report as much" in printed.out
        page = (tmp_path / "out" / "page.md").read_text()
        assert page.index(said) < page.index("## Verdicts")
        assert "nothing is judged of loss=0.0, potential (0 of 2); loss=0.9, potential (0 of 2)" in page
        assert FINDING not in page
        assert said in (tmp_path / "out" / "page.html").read_text()
    assert set(pd.read_csv(tmp_path / "out" / "contrasts.csv").query("within == 'potential'")["verdict"]) == {"no data"}
    sweep = str(tmp_path / "out" / "sweep")
    assert main(["report", sweep, "--out", str(tmp_path / "report")]) == 1
    assert said in capsys.readouterr().err
    assert said in (tmp_path / "report" / "page.md").read_text()
    assert main(["sweep", f"{sweep}/sweep.toml", "--out", sweep]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == f"deltaswarm: {said}"


SMALLER = QUESTION.replace("repeats = 7", "repeats = 2").replace("margin = 1.5", "margin = 1.5\nexpect = 'undecided'")
SMALLER = SMALLER.partition("[[finding]]")[0]


@pytest.fixture
def frozen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a study file that was frozen years ago."""
    (tmp_path / "own.toml").write_text(SMALLER)
    with monkeypatch.context() as earlier:
        earlier.setattr(provenance, "now", lambda: "2020-01-02T03:04:05+00:00")
        assert main(["study", str(tmp_path / "own.toml"), "--out", str(tmp_path / "out"), "--freeze"]) == 0
    return tmp_path


def test_a_study_that_differs_from_its_protocol_says_so_until_it_is_amended(frozen: Path, capsys: Printed) -> None:
    """With exit code 3, whether it is run or rendered; its page, too. The amendment's reason then stands there."""
    command = ["study", str(frozen / "own.toml"), "--out", str(frozen / "out")]
    page = frozen / "out" / "page.md"
    assert main(command) == 0
    assert page.read_text().splitlines()[2].startswith("Frozen on 2020-01-02T03:04:05+00:00, before its runs")
    assert page.read_text().splitlines()[2].endswith("Surprises: 0 of 1.")
    (frozen / "own.toml").write_text(SMALLER.replace("margin = 1.5", "margin = 1.6"))
    for more in ([], ["--render"]):
        capsys.readouterr()
        assert main([*command, *more]) == 3
        line = (
            "differs from its protocol of 2020-01-02T03:04:05+00:00, without an amendment: claim.alike.margin was 1.5"
        )
        assert line in capsys.readouterr().err
        assert line in page.read_text().partition("## ")[0]
    assert main([*command, "--amend", "The margin was a typo."]) == 0
    assert main([*command, "--render"]) == 0
    assert "after the runs began: The margin was a typo." in page.read_text()
    assert "| claim.alike.margin | 1.5 | 1.6 |" in page.read_text()


def test_a_protocol_that_was_edited_by_hand_is_named(frozen: Path, capsys: Printed) -> None:
    command = ["study", str(frozen / "own.toml"), "--out", str(frozen / "out")]
    assert main(command) == 0
    protocol = frozen / "out" / "protocol.json"
    protocol.write_text(protocol.read_text().replace('"margin": 1.5', '"margin": 1.6'))
    (frozen / "own.toml").write_text(SMALLER.replace("margin = 1.5", "margin = 1.6"))
    assert main([*command, "--render"]) == 3
    assert "protocol.json was edited by hand" in capsys.readouterr().err
    assert "protocol.json was edited by hand" in (frozen / "out" / "page.md").read_text()


def test_a_study_is_not_frozen_beside_its_runs(done: Path, tmp_path: Path, capsys: Printed) -> None:
    (tmp_path / "own.toml").write_text(QUESTION)
    command = ["study", str(tmp_path / "own.toml"), "--out"]
    assert main([*command, str(done / "out"), "--freeze"]) == 2
    assert "before its first run" in capsys.readouterr().err
    assert main([*command, str(tmp_path / "out"), "--freeze", "--repeats", "3"]) == 2
