"""A pilot's table and differences, by numbers worked out by hand; how the number of participants is searched for."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_sessions import pilot, power
from deltaswarm_sessions.pilot import Question, plan_participants
from deltaswarm_sessions.power import ADJUSTED, SIGNED_RANK, T_TEST, Pilot, fit, powers
from deltaswarm_sessions.settings import load_session
from tests.support.sessions import a_file
from tests.support.tiers import in_one_test

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
    assert (
        "problem"
        not in planned(tmp_path, at_the_horizon(tmp_path / "a", 2), metric="told_s", test=T_TEST)["metrics"]["told_s"]
    )
    assert planned(tmp_path, at_the_horizon(tmp_path / "b", 4, "load"), metric="load", test=T_TEST)["metrics"]["load"]
    with pytest.raises(CommandError, match=r"told_s below its ceiling, horizon_s.*got 3 of 4 runs at it in B"):
        planned(tmp_path, at_the_horizon(tmp_path / "c", 3), metric="told_s", test=T_TEST)


def test_a_mean_has_its_error_and_interval() -> None:
    """3 of 1, 2, 3 and 6: the squares of the residuals add up to 14, with 3 degrees of freedom."""
    found = fit(np.array([1.0, 2.0, 3.0, 6.0]))
    assert found is not None
    assert found.mean == pytest.approx(3)
    assert [*found.residuals] == pytest.approx([-2, -1, 0, 3])
    assert (found.degrees, found.parameters) == (3, 1)
    assert found.deviation == pytest.approx(2.160247)
    assert found.error == pytest.approx(1.080123)
    assert found.interval == pytest.approx((-0.437435, 6.437435), abs=1e-5)


def test_what_position_adds_is_removed() -> None:
    """10 and 2 for each position; residuals of 1 with 2 degrees of freedom. Redundant columns change nothing."""
    position = np.array([[1.0], [1.0], [-1.0], [-1.0]])
    for others in (position, np.hstack([position, -position, 3 * position])):
        found = fit(np.array([13.0, 11.0, 9.0, 7.0]), others)
        assert found is not None
        assert (found.mean, found.degrees, found.parameters) == (pytest.approx(10), 2, 2)
        assert [*found.residuals] == pytest.approx([1, -1, 1, -1])
        assert found.deviation == pytest.approx(math.sqrt(2))
        assert found.error == pytest.approx(math.sqrt(0.5))
        assert found.interval == pytest.approx((10 - 3.042435, 10 + 3.042435))


def test_what_cannot_be_fitted_is_none() -> None:
    """One order alone is the condition itself; as many parameters as differences leave nothing."""
    assert fit(np.arange(4.0), np.ones((4, 1))) is None
    assert fit(np.arange(4.0), np.full((4, 1), -2.0)) is None
    assert fit(np.array([1.0])) is None
    assert fit(np.array([1.0, 2.0])) is not None
    assert fit(np.arange(2.0), np.array([[1.0], [-1.0]])) is None
    assert fit(np.arange(3.0), np.array([[1.0], [-1.0], [1.0]])) is not None


@in_one_test(
    ("drawn", "effect", "is_rejected"),
    [
        ((2, 2), 1.0, False),  # t = 1 / (sqrt(4/3) / 2) = 1.73
        ((2, 2), 2.0, True),  # t = 3.46, above 3.18
        ((2, 2), -2.0, True),
        ((3, 1), 2.0, False),  # t = (2 - 0.5) / (1 / 2) = 3
        ((3, 1), -2.0, True),  # t = -5
        ((1, 3), -2.0, False),
        ((4, 0), 1e6, False),  # all are equal
    ],
)
def test_a_t_test_rejects_from_its_limit_on(drawn: tuple[int, int], effect: float, is_rejected: bool) -> None:
    """Of four differences, which are the effect less or more 1, at 5 % with 3 degrees of freedom."""
    rows = np.array([drawn], dtype=float)
    found = power._t_rejects(rows, np.array([-1.0, 1.0]), effect, 0.05, 3)
    assert [*found] == [is_rejected]


@in_one_test(
    ("drawn", "effect", "is_rejected"),
    [
        ((6, 0), 5.0, True),  # all six are positive: p = 2/64
        ((5, 0), 5.0, False),  # p = 2/32
        ((0, 6), -5.0, True),
        ((5, 1), 1.5, True),  # 0.5 five times and 2.5: all six are positive
    ],
)
def test_a_signed_rank_test_rejects_from_its_limit_on(drawn: tuple[int, int], effect: float, is_rejected: bool) -> None:
    """At 5 %, five differences of one sign are not enough, six are."""
    rows = np.array([drawn], dtype=float)
    found = power._signed_rank_rejects(rows, np.array([-1.0, 1.0]), effect, 0.05)
    assert [*found] == [is_rejected]


def test_the_search_doubles_and_then_closes_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the least multiple that has the wanted power, or on the largest that is allowed; errors are binomial."""
    some = Pilot(1.0, 1.0, (0.0, 2.0), np.array([1.0, -1.0]), 1)

    def search(least: int, group: int) -> list[power.Power]:
        monkeypatch.setattr(power, "_power", lambda pilot, effect, n, *_: 0.8 if n >= least else 0.5)
        return powers(some, 1.0, group=group, wanted=0.8, alpha=0.05, test=T_TEST, seed=1)

    assert [one.participants for one in search(28, 4)] == [4, 8, 16, 24, 28, 32]
    assert [one.participants for one in search(4, 4)] == [4]
    assert [one.participants for one in search(6, 6)] == [6]
    assert [one.participants for one in search(7, 6)] == [6, 12]
    assert [one.participants for one in search(10**6, 12)] == [12, 24, 48, 96, 192, 384, 768, 996]
    assert [one.participants for one in search(980, 12)] == [
        12,
        24,
        48,
        96,
        192,
        384,
        768,
        876,
        936,
        960,
        972,
        984,
        996,
    ]
    first, *_, last = search(28, 4)
    assert (first.power, first.error) == (0.5, pytest.approx(0.005))
    assert (last.power, last.error) == (0.8, pytest.approx(0.004))


@in_one_test(
    ("test", "alpha", "expected"),
    [
        (T_TEST, 0.05, [0.1258, 0.6286, 0.9226, 0.9896]),
        (ADJUSTED, 0.05, [0.1258, 0.6286, 0.9226, 0.9896]),
        (SIGNED_RANK, 0.05, [0.0, 0.6785, 0.8392, 0.9740]),
        (T_TEST, 0.01, [0.0139, 0.1623, 0.5290, 0.8406]),
    ],
)
def test_the_power_for_a_small_pilot(test: str, alpha: float, expected: list[float]) -> None:
    """Within six standard errors for 4, 8, 12 and 16 participants; the same seed gives the same numbers."""
    found = fit(np.array([1.0, 2.0, 3.0, 6.0]))
    assert found is not None
    tried = powers(found, 2.0, group=4, wanted=0.8, alpha=alpha, test=test, seed=7)
    assert [one.participants for one in tried] == [4, 8, 12, 16]
    assert [one.power for one in tried] == pytest.approx(expected, abs=0.03)
    assert tried == powers(found, 2.0, group=4, wanted=0.8, alpha=alpha, test=test, seed=7)
    assert tried != powers(found, 2.0, group=4, wanted=0.8, alpha=alpha, test=test, seed=8)


def test_the_tests_have_the_names_that_the_command_takes() -> None:
    """The first is the default."""
    assert [*power.TESTS] == ["adjusted", "t", "signed-rank"]
    assert Question().test == "adjusted"
    assert (Question().power, Question().alpha) == (0.8, 0.05)


def test_as_many_participants_as_parameters_have_no_power() -> None:
    """One more has some."""
    found = fit(np.array([13.0, 11.0, 9.0, 7.0]), np.array([[1.0], [1.0], [-1.0], [-1.0]]))
    assert found is not None
    assert power._power(found, 50.0, 2, 0.05, ADJUSTED, np.random.default_rng(1)) == 0.0
    assert power._power(found, 50.0, 3, 0.05, ADJUSTED, np.random.default_rng(1)) > 0.5


def test_a_plan_has_the_pilots_numbers(tmp_path: Path) -> None:
    """Training, other conditions and runs that were cut off do not count; nor do columns without numbers."""
    cut_off = "5 A 1 0 r 1 5 0 9 1 x inf -"
    file = a_table(tmp_path, cut_off)
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
    assert (isa["low"], isa["high"]) == pytest.approx((-0.437435, 6.437435), abs=1e-5)
    assert isa["deviation"] == pytest.approx(2.160247)
    enough = [one["participants"] for one in isa["powers"] if one["power"] >= 0.8]
    assert isa["participants"] == enough[0]
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
    with pytest.raises(CommandError, match=r"must have isa in A and in B of at least 6 participants"):
        planned(tmp_path, file)


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (
            {"metric": "isa"},
            "must have isa in A and in B of at least 6 participants, to adjust for position and stream "
            "(got 4, which are 1, 2, 3, 4)",
        ),
        ({"metric": "isa", "test": T_TEST, "conditions": ["A", "A"]}, "--conditions must be two of A, B (got A, A)"),
        ({"metric": "items", "test": T_TEST}, "--metric must be one of isa (got 'items')"),
        ({"metric": "seed", "test": T_TEST}, "--metric must be one of isa (got 'seed')"),
    ],
)
def test_a_question_that_the_pilot_cannot_answer_is_refused(
    question: dict[str, Any], said: str, tmp_path: Path
) -> None:
    """With what it has."""
    with pytest.raises(CommandError) as told:
        planned(tmp_path, a_table(tmp_path), **question)
    assert said in str(told.value)


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


def test_who_lacks_a_run_is_named(tmp_path: Path) -> None:
    """A run without a value counts as lacking."""
    file = a_table(
        tmp_path, "5 A 1 0 r 1 5 1 2 - x inf -", "5 B 2 0 r 1 5 1 - - x inf -", "11 A 1 0 r 1 5 1 2 - x inf -"
    )
    with pytest.raises(CommandError, match=r"of at least 6 .*\(got 4, which are 1, 2, 3, 4; without: 5, 11\)"):
        planned(tmp_path, file, metric="isa")
    assert planned(tmp_path, file, metric="isa", test=T_TEST)["metrics"]["isa"]["pilot"] == 4


def test_more_streams_need_more_participants(tmp_path: Path) -> None:
    """One for each further stream; without streams, position alone is adjusted for."""
    with pytest.raises(CommandError, match="of at least 7 participants"):
        planned(tmp_path, a_table(tmp_path, "5 A 1 2 r 1 5 1 2 - x inf -"), metric="isa")
    with pytest.raises(CommandError, match="of at least 5 participants"):
        planned(tmp_path, a_table(tmp_path, streams=False), metric="isa")


def test_position_and_stream_are_columns_of_the_fit() -> None:
    """The second run's less the first's."""

    def run(position: int, stream: str) -> dict[str, str]:
        return {"position": str(position), "stream": stream}

    found = pilot._others([(run(1, "0"), run(3, "2")), (run(2, "1"), run(1, "0")), (run(1, "0"), run(2, "0"))])
    assert found.tolist() == [[2, -1, 0, 1], [-1, 1, -1, 0], [1, 0, 0, 0]]
    assert pilot._others([(run(1, ""), run(2, ""))]).tolist() == [[1]]
    assert pilot._others([(run(1, "0"), run(2, "0"))]).tolist() == [[1, 0]]


ROW = {"pilot": 8, "difference": 10.25, "low": 4.0, "high": 16.5, "deviation": 3.14159, "effect": 5.0}
TRIED = [{"participants": 4, "power": 0.5, "error": 0.005}, {"participants": 8, "power": 0.8125, "error": 0.0039}]
PLAN = {"contrast": "B - A", "test": "paired t-test", "alpha": 0.05, "power": 0.8, "multiple_of": 4}


def test_one_metric_is_printed_with_its_powers() -> None:
    """A line, and a table of the numbers that were tried."""
    metrics = {"isa": {**ROW, "powers": TRIED, "participants": 8}}
    assert pilot.text({**PLAN, "metrics": metrics}).split("\n") == [
        "B - A, by the paired t-test at alpha 0.05, with a power of 0.8 and 10000 resamples; participants in multiples "
        "of 4",
        "",
        "metric  pilot  difference  95 % interval  deviation  effect  participants",
        "isa     8      10.2        4 to 16.5      3.14       5       8",
        "",
        "participants  power  standard error",
        "4             0.500  0.005",
        "8             0.812  0.004",
    ]


def test_several_metrics_are_printed_with_a_line_each() -> None:
    """Those of which nothing can be said come last, with the reason."""
    metrics = {"isa": {**ROW, "powers": TRIED, "participants": None}, "items": {"problem": "must vary"}}
    assert pilot.text({**PLAN, "metrics": metrics}).split("\n")[2:] == [
        "metric  pilot  difference  95 % interval  deviation  effect  participants",
        "isa     8      10.2        4 to 16.5      3.14       5       more than 1000",
        "",
        "items: must vary",
    ]


def test_a_measure_of_the_swarm_is_no_measure_of_a_person(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command says so, since participants with the same stream are no replicates of the swarm."""
    table = a_table(tmp_path / "pilot")
    command = ["session", str(a_file(tmp_path, 2)), "--plan", str(tmp_path / "pilot"), "--test", "t"]
    assert main(command) == 0
    assert "measures of the swarm" not in capsys.readouterr().err
    table.write_text(table.read_text().replace("isa", "told_s"))
    assert main(command) == 0
    assert "measures of the swarm, not of the person: told_s; participants" in capsys.readouterr().err
