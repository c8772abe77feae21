"""The number of participants from a pilot's tables: what is read of them, what is refused, and what is printed."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import statsmodels.formula.api as smf
from scipy import stats as scipy_stats

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_sessions import pilot
from deltaswarm_sessions.pilot import Question, plan_participants
from deltaswarm_sessions.plan import order_of
from deltaswarm_sessions.power import T_TEST
from deltaswarm_sessions.settings import load_session
from tests.support.complaints import Printed
from tests.support.sessions import a_file

HEAD = "participant condition position stream run attempt seed complete isa items word far training_value"
DIFFERENCES = {1: 1, 2: 2, 3: 3, 4: 6}
"""Of ISA between B and A, by participant."""


def a_table(folder: Path, *more: str, streams: bool = True) -> Path:
    """A pilot of four participants; `more`: further rows."""
    rows = [HEAD]
    for who, raised in DIFFERENCES.items():
        rows.append(f"{who} training 0 - 0-training 1 5 1 5 1 x inf 3")
        for condition, isa in (("A", 2), ("B", 2 + raised)):
            place = 1 + ((condition == "B") != (who % 2 == 0))
            rows.append(f"{who} {condition} {place} {who % 2 if streams else '-'} r 1 5 1 {isa} - x inf -")
    lines = [row.replace("-", "") if n else row for n, row in enumerate([*rows, *more])]
    folder.mkdir(exist_ok=True)
    (folder / "runs.tsv").write_text("".join(line.replace(" ", "\t") + "\n" for line in lines))
    return folder / "runs.tsv"


def planned(folder: Path, file: Path, **question: Any) -> dict[str, Any]:
    """What a session with two conditions needs."""
    settings, _ = load_session(str(a_file(folder, 2)))
    return plan_participants(settings, file, Question(**question))


def at_the_horizon(folder: Path, at: int, metric: str = "told_s") -> Path:
    """A pilot with a time in each run: under B, that of so many participants is the horizon of 100 s."""
    head, *rows = a_table(folder).read_text().splitlines()
    lines = [f"{head}\t{metric}\thorizon_s"]
    for row in rows:
        who, condition = int(row.split("\t")[0]), row.split("\t")[1]
        lines.append(f"{row}\t{100 if condition == 'B' and who <= at else 20 + who**2}\t100")
    (folder / "runs.tsv").write_text("\n".join(lines) + "\n")
    return folder / "runs.tsv"


def test_times_at_their_ceiling_plan_no_participants(tmp_path: Path) -> None:
    """More than half of a condition's runs at the horizon: how much longer they are, nobody knows."""
    for metric, at in (("told_s", 2), ("load", 4)):
        file = at_the_horizon(tmp_path / metric, at, metric)
        assert "problem" not in planned(tmp_path, file, metric=metric, test=T_TEST)["metrics"][metric]
    with pytest.raises(CommandError, match=r"told_s below its ceiling, horizon_s.*got 3 of 4 runs at it in B"):
        planned(tmp_path, at_the_horizon(tmp_path / "c", 3), metric="told_s", test=T_TEST)


def test_a_plan_has_the_pilots_numbers(tmp_path: Path) -> None:
    """Training, other conditions and runs that were cut off do not count; nor do columns without numbers."""
    file = a_table(tmp_path, "5 A 1 0 r 1 5 0 9 1 x inf -")
    found = planned(tmp_path, file, test=T_TEST)
    assert {name: value for name, value in found.items() if name != "metrics"} == {
        "contrast": "B - A",
        "test": "paired t-test",
        "alpha": 0.05,
        "power": 0.8,
        "multiple_of": 4,
    }
    assert [*found["metrics"]] == ["isa"]
    isa = found["metrics"]["isa"]
    assert (isa["pilot"], isa["difference"], isa["effect"]) == (4, pytest.approx(3), pytest.approx(3))
    assert (isa["low"], isa["high"], isa["deviation"]) == pytest.approx((-0.437435, 6.437435, 2.160247), abs=1e-5)
    assert isa["participants"] == next(one["participants"] for one in isa["powers"] if one["power"] >= 0.8)
    back = planned(tmp_path, file, test=T_TEST, conditions=["B", "A"], metric="isa", effect=-2.0)["metrics"]["isa"]
    assert (back["difference"], back["effect"]) == (pytest.approx(-3), -2.0)


def test_a_metric_that_says_nothing_has_its_reason(tmp_path: Path) -> None:
    """Beside those of which something can be said; if there is none, the pilot is refused."""
    file = a_table(tmp_path)
    file.write_text(file.read_text().replace("inf", "4"))
    found = planned(tmp_path, file, test=T_TEST)["metrics"]
    assert [*found] == ["isa", "far"]
    assert found["far"] == {"problem": "must have participants whose difference in far varies (got 0 of each)"}
    with pytest.raises(CommandError, match=r"difference in far varies \(got 0 of each\)"):
        planned(tmp_path, file, test=T_TEST, metric="far")


ISA, T = {"metric": "isa"}, {"test": T_TEST}
LEFT_OUT = ("5 A 1 0 r 1 5 1 2 - x inf -", "5 B 2 0 r 1 5 1 - - x inf -", "11 A 1 0 r 1 5 1 2 - x inf -")


@pytest.mark.parametrize(
    ("more", "question", "said"),
    [
        ((), {}, "must have isa in A and in B of at least 6 participants"),
        (
            *((), ISA),
            "must have isa in A and in B of at least 6 participants, to adjust for position and stream "
            "(got 4, which are 1, 2, 3, 4)",
        ),
        (
            LEFT_OUT,
            ISA,
            "of at least 6 participants, to adjust for position and stream (got 4, which are 1, 2, 3, 4; w",
        ),
        (LEFT_OUT, ISA, "; without: 5, 11)"),
        (("5 A 1 2 r 1 5 1 2 - x inf -",), ISA, "of at least 7 participants"),
        ((), T | {"conditions": ["A", "A"]}, "--conditions must be two of A, B (got A, A)"),
        ((), T | {"conditions": ["A", "D"]}, "--conditions must be two of A, B (got A, D)"),
        ((), T | {"metric": "items"}, "--metric must be one of isa (got 'items')"),
        ((), T | {"metric": "seed"}, "--metric must be one of isa (got 'seed')"),
    ],
)
def test_a_question_that_the_pilot_cannot_answer_is_refused(
    more: tuple[str, ...], question: dict[str, Any], said: str, tmp_path: Path
) -> None:
    """With what it has; each further stream needs one participant more."""
    with pytest.raises(CommandError) as told:
        planned(tmp_path, a_table(tmp_path, *more), **question)
    assert said in str(told.value)


def test_without_streams_position_alone_is_adjusted_for(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="of at least 5 participants"):
        planned(tmp_path, a_table(tmp_path, streams=False), metric="isa")


@pytest.mark.parametrize(
    ("column", "cell", "metric"),
    [("isa", "four", "isa"), ("isa", "four", None), ("far", "inf", "far"), ("complete", "yes", None)],
)
def test_a_cell_that_is_no_number_is_named(column: str, cell: str, metric: str | None, tmp_path: Path) -> None:
    """By line, column and what is there, for the metric that is asked for and for each known measure."""
    file = a_table(tmp_path)
    head, first, *rows = (line.split("\t") for line in file.read_text().splitlines())
    first[head.index(column)] = cell
    file.write_text("\n".join("\t".join(row) for row in (head, first, *rows)) + "\n")
    with pytest.raises(CommandError, match=rf"runs.tsv .*line 2, column {column}: must be .*number \(got '{cell}'\)"):
        planned(tmp_path, file, metric=metric)


def test_a_pilot_without_measures_is_no_list_of_none(tmp_path: Path) -> None:
    """The table is named, not the option."""
    file = a_table(tmp_path)
    file.write_text(file.read_text().replace("\t1\t5\t1\t", "\t1\t5\t0\t"))
    with pytest.raises(CommandError, match=r"runs.tsv must have complete and valid runs"):
        planned(tmp_path, file, metric="isa")


ROW = {"pilot": 8, "difference": 10.25, "low": 4.0, "high": 16.5, "deviation": 3.14159, "effect": 5.0}
TRIED = [{"participants": 4, "power": 0.5, "error": 0.005}, {"participants": 8, "power": 0.8125, "error": 0.0039}]
PLAN = {"contrast": "B - A", "test": "paired t-test", "alpha": 0.05, "power": 0.8, "multiple_of": 4}
COLUMNS = "metric  pilot  difference  95 % interval  deviation  effect  participants"


def test_one_metric_is_printed_with_its_powers_and_several_with_a_line_each() -> None:
    """A table of the numbers that were tried; those of which nothing can be said come last, with the reason."""
    metrics = {"isa": {**ROW, "powers": TRIED, "participants": 8}}
    assert pilot.text({**PLAN, "metrics": metrics}).split("\n") == [
        "B - A, by the paired t-test at alpha 0.05, with a power of 0.8 and 10000 resamples; participants in multiples "
        "of 4",
        "",
        COLUMNS,
        "isa     8      10.2        4 to 16.5      3.14       5       8",
        "",
        "participants  power  standard error",
        "4             0.500  0.005",
        "8             0.812  0.004",
    ]
    metrics = {"isa": {**ROW, "powers": TRIED, "participants": None}, "items": {"problem": "must vary"}}
    assert pilot.text({**PLAN, "metrics": metrics}).split("\n")[2:] == [
        COLUMNS,
        "isa     8      10.2        4 to 16.5      3.14       5       more than 1000",
        "",
        "items: must vary",
    ]


STREAM, POSITION = 20, 5
"""What the second stream and the second position add to NASA-TLX."""


def a_pilot(folder: Path, participants: int) -> Path:
    """Tables of a pilot: B raises NASA-TLX by 10 on average, ISA by 1 in everybody; nobody commanded anything."""
    rows = []
    for who in range(1, participants + 1):
        rows.append((who, "training", 0, "", "0-training", 1, "ff", 99, 5, ""))
        for place, (condition, stream) in enumerate(order_of(who, 2), 1):
            raised = condition * (10 + who * 3 % 5 - 2) + STREAM * stream + POSITION * place
            own = (1, "ff", 40 + 3 * who + raised, 2 + condition, "")
            rows.append((who, "AB"[condition], place, stream, f"{place}-{'AB'[condition]}", *own))
    rows.append((1, "B", 2, 0, "2-B", 0, "ff", 1e6, 1, ""))  # cut off
    head = [*HEAD.split()[:5], "complete", "digest", "tlx_raw", "isa", "commands"]
    folder.mkdir(exist_ok=True)
    pd.DataFrame(rows, columns=head).to_csv(folder / "runs.tsv", sep="\t", index=False)
    return folder / "runs.tsv"


def test_adjusted_differences_are_those_of_the_mixed_model(tmp_path: Path) -> None:
    """The model of the page on sessions: the same effect of the condition, with the same standard error."""
    table = a_pilot(tmp_path, 11)
    runs = pd.read_csv(table, sep="\t")
    done = runs[(runs.position > 0) & (runs.complete == 1)]
    model = smf.mixedlm("tlx_raw ~ C(condition) + C(stream) + position", done, groups="participant").fit()
    found = planned(tmp_path, table, metric="tlx_raw")["metrics"]["tlx_raw"]
    error = (found["high"] - found["low"]) / 2 / scipy_stats.t.isf(0.025, 11 - 3)
    assert found["difference"] == pytest.approx(model.params["C(condition)[T.B]"], rel=1e-3)
    assert error == pytest.approx(model.bse["C(condition)[T.B]"], rel=1e-2)


def test_a_plan_tells_the_number_of_participants(tmp_path: Path, capsys: Printed) -> None:
    """For one metric with a table of powers; the same each time."""
    a_pilot(tmp_path / "data", 10)
    command = ["session", str(a_file(tmp_path, 2)), "--plan", str(tmp_path / "data")]
    metric = [*command, "--metric", "tlx_raw", "--effect", "2"]
    assert main([*metric, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["contrast"], told["multiple_of"]) == ("B - A", 4)
    tlx = told["metrics"]["tlx_raw"]
    assert (tlx["pilot"], tlx["effect"], tlx["participants"]) == (10, 2.0, 12)
    assert tlx["difference"] == pytest.approx(10, abs=1)
    assert tlx["powers"][0]["participants"] == 4
    assert main(metric) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "adjusted for position and stream" in printed.out
    assert main([*metric, "--test", "t", "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)["metrics"]["tlx_raw"]
    assert plain["deviation"] > STREAM
    assert plain["participants"] is None, "streams differ too much for it"
    assert main([*command, "--test", "signed-rank"]) == 0
    printed = capsys.readouterr()
    assert "uncertain" in printed.err
    lines = {line.split()[0]: line for line in printed.out.splitlines() if line}
    assert int(lines["tlx_raw"].split()[-1]) % 4 == 0
    assert "varies (got 1 of each)" in lines["isa:"]
    assert not {"commands", "attempt", "digest"} & {*lines}


def test_a_measure_of_the_swarm_is_no_measure_of_a_person(tmp_path: Path, capsys: Printed) -> None:
    """The command says so, since participants with the same stream are no replicates of the swarm."""
    table = a_table(tmp_path / "pilot")
    command = ["session", str(a_file(tmp_path, 2)), "--plan", str(tmp_path / "pilot"), "--test", "t"]
    assert main(command) == 0
    assert "measures of the swarm" not in capsys.readouterr().err
    table.write_text(table.read_text().replace("isa", "told_s"))
    assert main(command) == 0
    assert "measures of the swarm, not of the person: told_s; participants" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("conditions", "options", "said"),
    [
        (2, ["--effect", "3"], "--effect must be"),
        (2, ["--metric", "isa", "--effect", "0"], "--effect must be"),
        (3, [], "--conditions must be two of A, B, C (got none, and the session has 3)"),
        (3, ["--conditions", "A", "C", "--metric", "isa"], "(got 0; without: 1, 2, 3, 4)"),
    ],
)
def test_what_cannot_be_planned_is_refused(
    conditions: int, options: list[str], said: str, tmp_path: Path, capsys: Printed
) -> None:
    """With what must hold."""
    a_table(tmp_path / "data")
    assert main(["session", str(a_file(tmp_path, conditions)), "--plan", str(tmp_path / "data"), *options]) == 2
    assert said in capsys.readouterr().err


def test_other_files_are_no_pilot(tmp_path: Path, capsys: Printed) -> None:
    """None at all, and one with other columns; options of a plan need a plan."""
    command = ["session", str(a_file(tmp_path, 2))]
    for content in (None, "a\tb\n1\t2\n"):
        if content:
            (tmp_path / "runs.tsv").write_text(content)
        assert main([*command, "--plan", str(tmp_path)]) == 2
        assert "runs.tsv must be the table of runs" in capsys.readouterr().err
    for option, needed in (
        ("--power 0.9", "--plan"),
        ("--effect 0", "--plan"),
        ("--wide", "--table"),
        ("--reason x", "--withdraw"),
    ):
        assert main([*command, "--participant", "1", *option.split()]) == 2
        assert f"{option.split()[0]} must be given with {needed}" in capsys.readouterr().err
