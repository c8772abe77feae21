"""Values at their ceiling: refused before the runs where that is known, not decided after them, shown as no less."""

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from deltaswarm_studies.ceilings import at_ceiling
from deltaswarm_studies.contrasts import smallest_effects
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.page import pages
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import FAST, LEVELS, MODES, OWN, SAME, SLOW, SWEEP, Value, made, table
from tests.support.tiers import in_one_test

HORIZON_S = 100.0
CONTRAST = (
    '[[contrast]]\nid = "limit"\nfactor = "loss"\nreference = "loss=0.0"\nmargin = 1.1\nmetrics = ["waiting_all"]\n'
)


def claim(kind: str, **keys: Any) -> str:
    own = {"id": "it", "text": "it", "kind": kind, "metric": "waiting_all", **keys}
    return "[[claim]]\n" + "".join(f"{name} = {value!r}\n" for name, value in own.items())


def judged(own: str, waiting: Value) -> Evidence:
    study = made(OWN + own)
    return Evidence.of_sweep(study, table(waiting).assign(**{"arrivals.times": "t"}), pd.DataFrame())


def stuck(*variants: str, below: int = 0) -> Value:
    """Replicates at the ceiling under these variants, but for the first few, and around 30 s under all others."""

    def waiting(level: str, mode: str, replicate: int) -> float:
        is_stuck = f"{level}, {mode}" in variants and replicate >= below
        return HORIZON_S if is_stuck else 30.0 * 1.02**replicate

    return waiting


def verdict(own: str, waiting: Value) -> str:
    evidence = judged(own, waiting)
    line = [line for line in evidence.doubts if line.startswith("Not decided: the claim 'it'")]
    found = str(evidence.claims["verdict"].iloc[0])
    assert bool(line) == (found == "undecided")
    return found


ORDER = claim("order", less=FAST, more=SLOW)


@in_one_test(
    ("own", "at", "expected"),
    [
        (ORDER, [SLOW], "holds"),  # longer times of the longer side change nothing
        (ORDER, [FAST], "refuted"),
        (ORDER, [FAST, SLOW], "undecided"),
        (claim("order", less=FAST, more=SLOW, at_least=2.5), [SLOW], "holds"),
        (claim("order", less=FAST, more=SLOW, at_least=3.5), [SLOW], "undecided"),  # 3.3 times or more
        (claim("order", less=FAST, more=SLOW, at_least=1.5), [FAST, SLOW], "undecided"),
        (claim("alike", a=FAST, b=SLOW, margin=1.2), [FAST, SLOW], "undecided"),  # equal, since both are cut off
        (claim("alike", a=FAST, b=SLOW, margin=1.2), [SLOW], "refuted"),
        (claim("alike", a=FAST, b=SLOW, margin=4.0), [SLOW], "undecided"),
        (claim("alike", a=SLOW, b=FAST, ratio=5.0, margin=1.1), [SLOW], "undecided"),  # 3.3 times or more
        (claim("alike", a=SLOW, b=FAST, ratio=2.0, margin=1.1), [SLOW], "refuted"),
        (claim("order", less=FAST, every=[SLOW]), [SLOW], "holds"),
        (claim("order", less=FAST, every=[SLOW]), [FAST, SLOW], "undecided"),
        (claim("value", of=SLOW, within=[90.0, 110.0]), [SLOW], "undecided"),
        (claim("value", of=SLOW, within=[20.0, 50.0]), [SLOW], "refuted"),
        (claim("value", of=SLOW, above=50.0), [SLOW], "holds"),
        (claim("published", of=SLOW, published=50.0, sd=1.0, n=9), [SLOW], "differs"),
        (
            claim("published", of=SLOW, published=150.0, sd=1.0, n=9),
            [SLOW],
            "undecided",
        ),  # it may be, beyond the horizon
        (claim("value", of=FAST, within=[20.0, 50.0]), [SLOW], "holds"),  # the other variant is not at its ceiling
    ],
)
def test_a_claim_keeps_the_verdict_that_longer_times_could_not_change(own: str, at: list[str], expected: str) -> None:
    assert verdict(own, stuck(*at)) == expected


@pytest.mark.parametrize(("stuck_at", "is_decided"), [(3, True), (4, False)])
def test_a_correlation_with_values_at_their_ceiling_is_not_decided(stuck_at: int, is_decided: bool) -> None:
    """If they are in more than half of the six variants, which then have no order."""
    own = claim("predicts", less="waiting", more="messages")
    variants = [f"{level}, {mode}" for level in LEVELS for mode in MODES]
    order: Value = lambda level, mode, replicate: 1.0 + variants.index(f"{level}, {mode}")  # noqa: E731
    evidence = Evidence.of_sweep(made(OWN + own), table(stuck(*variants[:stuck_at]), order, order), pd.DataFrame())
    assert evidence.claims["verdict"].tolist() != ["no data"]
    assert any(line.startswith("Not decided: the claim 'it'") for line in evidence.doubts) is not is_decided


def test_a_value_within_a_hundredth_of_the_ceiling_is_at_it() -> None:
    """Of a mean as near as that nearly all times are cut off."""
    study = made(OWN + CONTRAST)
    for value_s, is_at in ((99.0, True), (98.9, False)):
        runs = Evidence.of_sweep(study, table(lambda *_, at=value_s: at), pd.DataFrame()).runs
        assert bool(at_ceiling(study, runs)) is is_at


@pytest.mark.parametrize(("below", "expected"), [(0, "undecided"), (4, "undecided"), (5, "holds"), (10, "holds")])
def test_most_values_at_the_ceiling_are_more_than_half(below: int, expected: str) -> None:
    """With half of ten replicates below it, the median is not at the ceiling."""
    assert (
        judged(claim("value", of=SLOW, within=[1.0, 101.0]), stuck(SLOW, below=below)).claims["verdict"] == expected
    ).all()


def test_a_contrast_at_the_ceiling_is_not_decided() -> None:
    """Both sides at the horizon look alike; one side there is higher, and by how much nobody knows."""
    at = [f"{level}, {MODES[1]}" for level in LEVELS[:2]]
    evidence = judged(CONTRAST, stuck(*at, FAST))
    rows = evidence.contrasts.set_index(["level", "within"])["verdict"]
    assert rows["loss=0.5", MODES[1]] == "unclear"  # both at their ceiling: a ratio of 1 with p 1, "alike" without care
    assert rows["loss=0.9", MODES[1]] == "lower"  # than a reference at its ceiling
    assert rows["loss=0.9", MODES[0]] == "higher"
    assert rows["loss=0.5", MODES[0]] == "alike"
    assert [line for line in evidence.doubts if line.startswith("Not decided")] == [
        "Not decided: the contrast 'limit' (frames lost [share]: 0.5 against frames lost [share]: 0.0), since 10 of 10 "
        "values of 'Mean time until an event is sensed' in 'frames lost [share]: 0.5, hybrid 3' are at their ceiling, "
        "the horizon of 100 s."
    ]


@pytest.mark.parametrize(("at_s", "margin", "is_shown"), [(97.0, 1.1, False), (80.0, 1.3, False), (80.0, 1.2, True)])
def test_an_equivalence_needs_room_below_the_ceiling(at_s: float, margin: float, is_shown: bool) -> None:
    """Means of 97 s to a horizon of 100 s are within 1.1 times of anything that is longer, so that shows nothing."""
    near: Value = lambda level, mode, replicate: at_s + (replicate - 4.5) / 10  # noqa: E731
    own = CONTRAST.replace("1.1", f"{margin}") + claim("alike", a=FAST, b=SLOW, margin=margin)
    evidence = judged(own, near)
    assert set(evidence.contrasts["verdict"]) == {"alike" if is_shown else "unclear"}
    assert evidence.claims["verdict"].tolist() == ["holds" if is_shown else "undecided"]
    lines = [line for line in evidence.doubts if "leaves no room" in line]
    assert lines == [] if is_shown else lines[-1].startswith("Not decided: the claim 'it', since the horizon of 100 s")


def test_a_verdict_that_stays_is_of_a_bound() -> None:
    [line] = [line for line in judged(ORDER, stuck(SLOW)).doubts if "ceiling" in line]
    assert line == (
        "Only a bound: the estimate of the claim 'it', since 10 of 10 values of 'Mean time until an event is sensed' "
        "in 'frames lost [share]: 0.9, hybrid 3' are at their ceiling, the horizon of 100 s."
    )


def noisy(level: str, mode: str, replicate: int) -> float:
    """Around 30 s, with another order of the replicates at each level."""
    return 30.0 * (1 + replicate * (1 + int(level[-1])) % 7 / 100)


def test_a_pilot_at_its_ceiling_foretells_no_effect(tmp_path: Path) -> None:
    """Replicates that are all cut off do not vary; only comparisons below the ceiling tell how replicates differ."""
    study = made(OWN + CONTRAST)
    found = []
    for waiting in (noisy, lambda *of: HORIZON_S if of[0] == "loss=0.5" else noisy(*of), lambda *of: HORIZON_S):
        Evidence.of_sweep(study, table(waiting), pd.DataFrame()).runs.to_csv(tmp_path / "runs.csv", index=False)
        found.append(smallest_effects(study, tmp_path / "runs.csv")[0, "waiting_all"])
    assert found[2] is None
    assert [text is not None and float(text.removesuffix(" times")) > 1.01 for text in found[:2]] == [True, True]


def test_an_interaction_at_the_ceiling_is_not_decided() -> None:
    """Of two changes one is cut off, so their ratio says nothing."""
    own = '[[contrast]]\nid = "i"\nfactor = "loss"\npairs = [["loss=0.9", "loss=0.0"]]\nmetrics = ["waiting_all"]\n'
    own += f'across = "mode"\nacross_pairs = [["{MODES[1]}", "{MODES[0]}"]]\n'
    assert judged(own, stuck(SLOW)).contrasts["verdict"].tolist() == ["unclear"]
    assert judged(own, stuck(SAME)).contrasts["verdict"].tolist() == ["unclear"]
    wide: Value = lambda level, mode, replicate: 30.0 * 1.02**replicate * (2 if f"{level}, {mode}" == SLOW else 1)  # noqa: E731
    assert judged(own, wide).contrasts["verdict"].tolist() == ["higher"]


def test_messages_have_no_ceiling() -> None:
    study = made(OWN + CONTRAST)
    runs = Evidence.of_sweep(study, table(stuck(SLOW), stuck(*study.levels)), pd.DataFrame()).runs
    assert [*at_ceiling(study, runs)] == [("waiting_all", SLOW)]


def test_a_metric_of_ones_own_has_its_columns_ceiling() -> None:
    own = (
        OWN.replace('"waiting_all", ', '"mine", ')
        + '[[metric]]\nname = "mine"\ncolumn = "waiting_time_s.restricted_mean"\n'
    )
    study = made(own)
    runs = Evidence.of_sweep(study, table(stuck(SLOW)), pd.DataFrame()).runs
    assert [*at_ceiling(study, runs)] == [("mine", SLOW)]


def test_estimates_at_their_ceiling_are_shown_as_no_less() -> None:
    stuck = table(lambda level, mode, replicate: 100.0 if level == "loss=0.9" else 40.0 + replicate)
    evidence = Evidence.of_sweep(made(OWN), stuck, pd.DataFrame())
    _, markdown, _ = pages(made(OWN), evidence, pd.DataFrame({"what": ["runs"], "value": ["60"]}))
    rows = [line.split(" | ") for line in markdown.splitlines() if line.startswith("| frames lost")]
    cells = {row[0].removeprefix("| "): row[2] for row in rows if len(row) > 2}
    assert tuple(cells[made(OWN).variant_title(name)] for name in (SLOW, SAME)) == ("> 100", "44.5 (1.4) [41.0, 48.0]")


# Before the runs

BARE = OWN.replace('metrics = ["waiting_all", "messages"]', 'metrics = ["messages"]')
LONG_WORK = SWEEP.replace("[scenario]", "[scenario]\nevents.work_agent_s = 606.0")  # six agents need 101 s, less a step
LATE = SWEEP.replace("[scenario]", "[scenario]\nuplink.latency_s = 101.0")
LONG_HORIZON = SWEEP.replace("metrics.horizon_s = 100.0", "metrics.horizon_s = 1000.0")


def about(metric: str, kind: str = "claim") -> str:
    tables = {
        "claim": claim("order", less=FAST, more=SLOW, metric=metric),
        "contrast": CONTRAST.replace("waiting_all", metric),
        "grid": f'[[grid]]\nmetric = "{metric}"\nrows = "mode"\nfactor = "loss"\ncolumns = {{ a = ["loss=0.0"] }}\n',
        "fit": f'[[fit]]\nfactor = "loss"\ntargets = [{{ level = "loss=0.0", metric = "{metric}", says = 1.0 }}]\n',
        "recovery": f'[[recovery]]\nmetric = "{metric}"\nfactor = "loss"\nlevel = "loss=0.9"\nreference = "loss=0.0"\n',
    }
    return BARE + tables[kind]


@in_one_test(
    ("own", "sweep", "complaint"),
    [
        *((about("completion_s", kind), LONG_WORK, "longer than 100 s, which the work of 6 agents") for kind in
          ("claim", "contrast", "grid", "fit", "recovery")),
        (BARE + claim("predicts", less="waiting", more="messages", metric="completion_s"), LONG_WORK, "(claim[0]:"),
        (about("completion_p95"), LONG_WORK, "(claim[0]: 'completion_p95')"),
        (about("completion_beyond"), LONG_WORK, "(claim[0]: 'completion_beyond')"),
        (about("told_worst_tenth", "contrast"), LATE, "longer than 101 s, which the delay of a report"),
        *((about(name), LONG_HORIZON, "no event could be followed for that long") for name in
          ("waiting_all", "waiting_p95", "told_worst_tenth", "worked_beyond")),
    ],
)  # fmt: skip
def test_what_the_horizon_decides_is_refused_before_the_runs(own: str, sweep: str, complaint: str) -> None:
    with pytest.raises(SettingsError) as caught:
        made(own, sweep)
    assert complaint in "\n".join(map(str, caught.value.problems))


@in_one_test(
    ("own", "sweep"),
    [
        (about("completion_s"), LONG_WORK.replace("606.0", "605.9")),
        (about("told_s"), LATE.replace("101.0", "99.0")),
        (about("waiting_all"), LATE),
        (about("messages"), LONG_HORIZON),
        (BARE.replace('"messages"', '"completion_s"'), LONG_WORK),  # shown, and not judged
    ],
)
def test_what_some_event_could_reach_is_not_refused(own: str, sweep: str) -> None:
    """Just before the horizon; other moments; what is only shown, as being longer."""
    assert made(own, sweep)


def test_means_to_different_horizons_are_not_compared() -> None:
    sweep = SWEEP.replace("metrics.horizon_s = 100.0", "").replace(
        "radio.loss = [0.0, 0.5, 0.9]", "metrics.horizon_s = [100.0, 200.0]"
    )
    own = OWN.replace("loss =", "horizon_s =") + CONTRAST.replace("loss=0.0", "horizon_s=100.0")
    across = own.replace('"loss"', '"horizon_s"')
    with pytest.raises(
        SettingsError, match=r"must be the same for .* which are compared \(contrast\[0\]: 'waiting_all'\)"
    ):
        made(across, sweep)
    within = own.replace('"loss"', '"mode"').replace('"horizon_s=100.0"', f'"{MODES[0]}"')
    assert made(within, sweep)
