"""Power by resampling: it agrees with closed forms, and the number of participants with the design."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import statsmodels.formula.api as smf
from scipy import stats as scipy_stats

from deltaswarm_cli.main import main
from deltaswarm_sessions import power
from deltaswarm_sessions.plan import order_of
from deltaswarm_sessions.power import (
    ADJUSTED,
    MAX_PARTICIPANTS,
    RESAMPLES,
    SIGNED_RANK,
    T_TEST,
    Array,
    Pilot,
    fit,
    powers,
)
from deltaswarm_studies.stats import contrast
from tests.support.complaints import Printed
from tests.support.sessions import a_file

NORMAL = np.asarray(scipy_stats.norm.ppf((np.arange(400) + 0.5) / 400))
"""A large pilot whose differences are normal with a standard deviation of nearly 1."""


def a_fit(differences: Array, others: Array | None = None) -> Pilot:
    """A pilot of these differences."""
    found = fit(differences, others)
    assert found
    return found


def t_power(effect: float, n: int, alpha: float) -> float:
    """The power of the paired t-test for normal differences with a standard deviation of 1."""
    limit = scipy_stats.t.isf(alpha / 2, n - 1)
    shifted = scipy_stats.nct(n - 1, effect * math.sqrt(n))
    return float(shifted.sf(limit) + shifted.cdf(-limit))


@pytest.mark.parametrize("effect", [0.5, -1.0])
@pytest.mark.parametrize("alpha", [0.05, 0.01])
def test_the_power_of_the_t_test_is_the_known_one(effect: float, alpha: float) -> None:
    """Within four standard errors, for every number tried; the answer is a multiple of the group within one of it."""
    deviation = float(np.std(NORMAL, ddof=1))
    tried = powers(a_fit(NORMAL), effect * deviation, group=4, wanted=0.8, alpha=alpha, test=T_TEST, seed=1)
    assert len(tried) > 3
    for n, found, error in tried:
        expected = t_power(effect, n, alpha)
        assert abs(found - expected) < 4 * max(error, math.sqrt(expected * (1 - expected) / RESAMPLES))
    answer = next(one.participants for one in tried if one.power >= 0.8)
    known = next(n for n in range(4, 400, 4) if t_power(effect, n, alpha) >= 0.8)
    assert abs(answer - known) <= 4


def test_without_an_effect_the_tests_keep_their_level() -> None:
    """No number of participants is enough. Opposite differences count for neither sign in the signed-rank test."""
    symmetric = np.asarray(scipy_stats.norm.ppf((np.arange(51) + 0.5) / 51))
    for test, least in ((T_TEST, 0.04), (SIGNED_RANK, 0.02)):
        tried = powers(a_fit(symmetric), 0.0, group=100, wanted=0.8, alpha=0.05, test=test, seed=1)
        assert tried[-1].participants == MAX_PARTICIPANTS
        assert all(least < one.power < 0.06 for one in tried)


def test_the_signed_rank_test_is_that_of_studies() -> None:
    """Row by row, with ties and zeros: it rejects exactly where the p-value of a contrast is at most alpha."""
    rng = np.random.default_rng(3)
    residuals = rng.integers(-6, 7, 9).astype(float)
    drawn = rng.multinomial(12, np.full(9, 1 / 9), size=200).astype(float)
    rejected = power._signed_rank_rejects(drawn, residuals, 3.0, 0.05)
    assert 10 < rejected.sum() < 190
    for times, is_rejected in zip(drawn, rejected, strict=True):
        differences = np.repeat(residuals + 3.0, times.astype(int))
        assert is_rejected == (contrast(differences, np.zeros(12), "difference").p() <= 0.05)


def test_four_participants_cannot_pass_the_signed_rank_test() -> None:
    """However large the effect: the least p-value is 1/8. Equal differences pass no t-test."""
    tried = powers(a_fit(NORMAL), 1e3, group=2, wanted=0.9, alpha=0.05, test=SIGNED_RANK, seed=1)
    assert [one.participants for one in tried if one.power == 0] == [2, 4]
    assert tried[-1].power == 1
    two = powers(a_fit(np.array([0.0, 1.0])), 10.0, group=2, wanted=0.99, alpha=0.05, test=T_TEST, seed=1)
    assert two[0].power == pytest.approx(0.5, abs=0.02)


HEAD = ["participant", "condition", "position", "stream", "run", "complete", "digest", "tlx_raw", "isa", "commands"]
STREAM, POSITION = 20, 5
"""What the second stream and the second position add to NASA-TLX."""


def a_pilot(folder: Path, participants: int, conditions: str = "AB") -> Path:
    """Tables of a pilot: B raises NASA-TLX by 10 on average, ISA by 1 in everybody; nobody commanded anything."""
    folder.mkdir(exist_ok=True)
    rows = []
    for who in range(1, participants + 1):
        rows.append([who, "training", 0, "", "0-training", 1, "ff", 99, 5, ""])
        for place, (condition, stream) in enumerate(order_of(who, len(conditions)), 1):
            raised = condition * (10 + who * 3 % 5 - 2) + STREAM * stream + POSITION * place
            own = [40 + 3 * who + raised, 2 + condition, ""]
            label = conditions[condition]
            rows.append([who, label, place, stream, f"{place}-{label}", 1, "ff", *own])
    rows.append([1, "B", 2, 0, "2-B", 0, "ff", 1e6, 1, ""])  # cut off
    with (folder / "runs.tsv").open("w", newline="") as stream_of_text:
        csv.writer(stream_of_text, delimiter="\t", lineterminator="\n").writerows([HEAD, *rows])
    return folder


def test_adjusted_differences_are_those_of_the_mixed_model(tmp_path: Path) -> None:
    """The model of the page on sessions: the same effect of the condition, with the same standard error."""
    pilot = a_pilot(tmp_path, 11)
    runs = pd.read_csv(pilot / "runs.tsv", sep="\t")
    done = runs[(runs.position > 0) & (runs.complete == 1)]
    formula = "tlx_raw ~ C(condition) + C(stream) + position"
    model = smf.mixedlm(formula, done, groups="participant").fit()
    a, b = (done[done.condition == label].set_index("participant") for label in "AB")
    others = np.column_stack([b.position - a.position, b.stream - a.stream]).astype(float)
    found = a_fit((b.tlx_raw - a.tlx_raw).to_numpy(float), others)
    assert found.parameters == 3
    assert found.mean == pytest.approx(model.params["C(condition)[T.B]"], rel=1e-3)
    assert found.error == pytest.approx(model.bse["C(condition)[T.B]"], rel=1e-2)


def test_the_power_of_adjusted_differences_is_that_of_fewer_degrees_of_freedom() -> None:
    """Of a normal population; without a degree of freedom there is no power."""
    others = np.resize([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]], (400, 2))
    pilot = a_fit(NORMAL + others @ [3.0, 7.0], others)
    tried = powers(pilot, pilot.deviation, group=3, wanted=0.9, alpha=0.05, test=ADJUSTED, seed=1)
    assert (tried[0].participants, tried[0].power) == (3, 0.0)
    for n, found, error in tried[1:]:
        limit = scipy_stats.t.isf(0.025, n - 3)
        # The variance is that of n resamples, which has n - 1 degrees of freedom; the limit is that of n - 3.
        expected = scipy_stats.nct(n - 1, math.sqrt(n)).sf(limit)
        assert abs(found - expected) < 4 * error + 0.01


def test_a_plan_tells_the_number_of_participants(tmp_path: Path, capsys: Printed) -> None:
    """For one metric with a table of powers; the same each time."""
    pilot = a_pilot(tmp_path / "data", 10)
    command = ["session", str(a_file(tmp_path, 2)), "--plan", str(pilot), "--metric", "tlx_raw", "--effect", "2"]
    assert main([*command, "--json"]) == 0
    planned = json.loads(capsys.readouterr().out)
    assert (planned["contrast"], planned["multiple_of"]) == ("B - A", 4)
    tlx = planned["metrics"]["tlx_raw"]
    assert (tlx["pilot"], tlx["effect"]) == (10, 2.0)
    assert tlx["difference"] == pytest.approx(10, abs=1)
    assert tlx["participants"] == 12
    assert tlx["powers"][0]["participants"] == 4
    assert main(command) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    rows = [line.split() for line in printed.out.splitlines()]
    table = {int(row[0]): float(row[1]) for row in rows if len(row) == 3 and row[0].isdecimal()}
    assert table[12] >= 0.8 > table[8]
    assert "adjusted for position and stream" in printed.out
    assert main([*command, "--test", "t", "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)["metrics"]["tlx_raw"]
    assert plain["deviation"] > STREAM
    assert plain["participants"] is None, "streams differ too much for it"
    assert main([*command, "--test", "t"]) == 0
    assert "more than 1000" in capsys.readouterr().out


def test_a_plan_without_a_metric_has_a_line_for_each(tmp_path: Path, capsys: Printed) -> None:
    """Those of which nothing can be said are named with the reason; the pilot's own effect is warned of."""
    pilot = a_pilot(tmp_path / "data", 10)
    command = ["session", str(a_file(tmp_path, 2)), "--plan", str(pilot), "--test", "signed-rank"]
    assert main(command) == 0
    printed = capsys.readouterr()
    assert "uncertain" in printed.err
    assert "signed-rank" in printed.out
    lines = {line.split()[0]: line for line in printed.out.splitlines() if line}
    assert int(lines["tlx_raw"].split()[-1]) % 4 == 0
    assert "varies (got 1 of each)" in lines["isa:"]
    assert not {"commands", "attempt", "digest"} & {*lines}


@pytest.mark.parametrize(
    ("participants", "conditions", "options", "said"),
    [
        (3, 2, ["--metric", "tlx_raw", "--test", "t"], "at least 4 participants (got 3, which are 1, 2, 3)"),
        (5, 2, ["--metric", "tlx_raw"], "at least 6 participants, to adjust for position and stream (got 5, which"),
        (1, 2, ["--metric", "tlx_raw"], "at least 6 participants, to adjust for position and stream (got 1, which is"),
        (1, 2, [], "at least 6 participants"),
        (5, 2, ["--metric", "tlx"], "--metric must be one of tlx_raw, isa (got 'tlx')"),
        (6, 2, ["--metric", "isa"], "varies (got 1 of each)"),
        (5, 3, [], "--conditions must be two of A, B, C (got none, and the session has 3)"),
        (5, 3, ["--conditions", "A", "D"], "--conditions must be two of A, B, C (got A, D)"),
        (5, 3, ["--conditions", "A", "C", "--metric", "isa"], "(got 0; without: 1, 2, 3, 4, 5)"),
        (5, 2, ["--effect", "3"], "--effect must be"),
        (5, 2, ["--metric", "isa", "--effect", "0"], "--effect must be"),
    ],
)
def test_what_cannot_be_planned_is_refused(
    participants: int, conditions: int, options: list[str], said: str, tmp_path: Path, capsys: Printed
) -> None:
    """With what must hold."""
    pilot = a_pilot(tmp_path / "data", participants)
    assert main(["session", str(a_file(tmp_path, conditions)), "--plan", str(pilot), *options]) == 2
    assert said in capsys.readouterr().err


def test_other_files_are_no_pilot(tmp_path: Path, capsys: Printed) -> None:
    """None at all, and one with other columns; options of a plan need a plan."""
    command = ["session", str(a_file(tmp_path, 2))]
    for content in (None, "a\tb\n1\t2\n"):
        if content:
            (tmp_path / "runs.tsv").write_text(content)
        assert main([*command, "--plan", str(tmp_path)]) == 2
        assert "runs.tsv must be the table of runs" in capsys.readouterr().err
    assert main([*command, "--participant", "1", "--power", "0.9"]) == 2
    assert "--power must be given with --plan" in capsys.readouterr().err
