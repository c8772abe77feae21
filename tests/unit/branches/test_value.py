"""What each order of a run was worth: the table, the figure and the line on the replay's page."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from deltaswarm_branches import value
from deltaswarm_branches.pairs import MEASURES
from deltaswarm_branches.parent import read_parent
from deltaswarm_branches.value import value_of_command
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.temporary import remove_left
from deltaswarm_orchestrator.recording.replay import worth_of
from deltaswarm_orchestrator.results.run_tables import read_rows
from tests.support.branching import AIR, SCRIPT, branched, ran, summary_of
from tests.support.complaints import Printed
from tests.support.swarms import COMMAND, wait_until
from tests.support.sweeping import marked, marked_command


@pytest.fixture(scope="module")
def scripted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("runs") / "run", SCRIPT, "run.duration_s=160", "run.step_s=0.5", "record=views")


def test_the_value_of_orders_is_written_beside_the_run(scripted: Path, capsys: Printed) -> None:
    """A row for each order and measure; an order for nobody is worth nothing, to the last bit, whatever is drawn."""
    capsys.readouterr()
    assert main(["value", str(scripted), "--replicates", "2", "--jobs", "2", "--json"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert 0 <= err.index("--replicates should be at least") < err.index("pairs of runs")  # before hours are spent
    rows = read_rows(scripted / "value" / "commands_value.csv")
    assert [(row["order"], row["at_s"], row["measure"]) for row in rows[::4]] == [
        ("0", "40.0", "waiting"),
        ("1", "90.0", "waiting"),
        ("2", "120.0", "waiting"),
    ]
    assert len(told["orders"]) == len(rows) == 12
    assert [row["verdict"] for row in rows[8:]] == ["nothing"] * 4
    assert {(row["value"], row["estimate"]) for row in rows[8:]} <= {("0", "0.0"), ("0.0", "0.0")}
    assert {row["verdict"] for row in rows[:8]} <= {"undecided", "nothing"}
    assert float(rows[0]["with_it"]) == summary_of(scripted)["waiting_time_s"]["restricted_mean"]
    record = seal.checked(scripted / "value" / "seal.json")
    assert record["run"]["digest"] == summary_of(scripted)["digest"]
    assert set(record["texts"]) == {"0", "1", "2"}
    assert worth_of(scripted) == scripted / "value" / "seal.json"
    assert main(["info", str(scripted)]) == 0
    drawn = read_rows(scripted / "value" / "replicates.csv")
    assert [(row["order"], row["replicate"]) for row in drawn] == [(one, run) for one in "012" for run in "012"]
    for side, column in (("with", "with_it"), ("without", "without")):
        assert [drawn[0][f"{name}_{side}"] for name in MEASURES] == [row[column] for row in rows[:4]]
    assert drawn[0]["messages_with"] != drawn[0]["messages_without"]
    assert len({row["messages_with"] for row in drawn[:3]}) == 3


def test_what_an_order_was_worth_is_the_run_minus_the_branch_without_it(scripted: Path, tmp_path: Path) -> None:
    """With the run's own randomness; and a branch is compared with its parent in the same pairs."""
    rows, _, later = value_of_command(read_parent(scripted), [1], replicates=0)
    branch = branched(scripted, tmp_path / "branch", "--drop-command", "1", "--replicates", "1", "--jobs", "1")
    with_it, without = summary_of(scripted), summary_of(branch)
    found = {row.effect.measure: row.effect.value for row in rows}
    assert found["messages"] == with_it["reports"]["arrived"] - without["reports"]["arrived"] != 0
    assert found["told"] == with_it["told_s"]["mean"] - without["told_s"]["mean"]
    assert later == "kept"
    difference = {row["measure"]: row["value"] for row in read_rows(branch / "value" / "difference.csv")}
    assert float(difference["messages"]) == -found["messages"]


def test_orders_of_a_rule_are_compared_with_later_ones_decided_kept_or_dropped(tmp_path: Path) -> None:
    """With dropped orders, neither side has those after it."""
    person = ("operator.person={policy='threshold', delta_limit=1, command_every_s=30}", "operator.threshold_hz=1")
    parent = read_parent(ran(tmp_path / "run", *person, *AIR, "run.duration_s=250"))
    values = {
        later: [row.effect.value for row in value_of_command(parent, [0], replicates=0, later=later)[0]]
        for later in ("", "kept", "dropped")
    }
    assert len({tuple(value) for value in values.values()}) >= 2
    assert value_of_command(parent, [0], replicates=0)[2] == "decided"


def test_with_dropped_orders_those_before_stay_also_of_the_same_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of two orders in one step comes before the second."""
    monkeypatch.setattr(value, "plan", lambda parent, step, difference: (step, difference.drop))
    orders = [SimpleNamespace(number=number, step=step) for number, step in enumerate((40, 40, 90))]
    parent: Any = SimpleNamespace(orders=orders)
    assert list(value._plans(parent, parent.orders[1], "dropped")) == [(40, (2,)), (40, (2, 1))]


def test_orders_that_are_not_there_are_refused(scripted: Path, tmp_path: Path, capsys: Printed) -> None:
    """An order that never left, and a run without orders."""
    plain = ran(tmp_path / "plain", "run.duration_s=50")
    capsys.readouterr()
    for run, options, says in (
        (scripted, ["--command", "7"], "--command must be an order that left the base: 0 to 2 (got 7)"),
        (plain, [], "RUN must be a run in which an order left the base"),
    ):
        assert main(["value", str(run), *options]) == 2
        assert capsys.readouterr().err.startswith(f"deltaswarm: {says}")


@pytest.mark.processes
def test_nothing_stays_of_a_command_that_is_killed(scripted: Path, tmp_path: Path) -> None:
    """Neither its workers nor Python's tracker, nor a temporary file that the next command would not remove."""
    command = [*COMMAND, "value", str(scripted), "--replicates", "1000", "--jobs", "2"]
    with marked_command(*command, TMPDIR=str(tmp_path)) as (process, mark):
        assert process.stderr is not None
        wait_until(lambda: "pairs of runs" in process.stderr.readline(), "both workers at work")
        process.kill()
        wait_until(lambda: not marked(mark, trackers=True), "the end of all processes")
    remove_left(tmp_path)
    assert not list(tmp_path.iterdir())
