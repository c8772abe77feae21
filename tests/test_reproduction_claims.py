"""The paper's claims: each has its runs, its tolerance and its place in CLAIMS.md; what fails is said first."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from deltaswarm_orchestrator.analysis import intervals
from deltaswarm_orchestrator.analysis.claims import judge
from deltaswarm_orchestrator.reproduction import paper_claims
from deltaswarm_orchestrator.reproduction.conditions import FIGURES, FULL, LARGE_READINGS
from deltaswarm_orchestrator.reproduction.page import claims_page
from deltaswarm_orchestrator.reproduction.paper_claims import (
    LIKENESSES,
    ORDERS,
    REMARKS,
    VALUES,
    claims,
    convergence_times_s,
)
from deltaswarm_orchestrator.sweeps.load import load_sweep

ROOT = Path(__file__).parents[1]
VARIANTS = [variant.label for variant in load_sweep("paper").variants]


def paper_table(**changed: float) -> pd.DataFrame:
    """Runs that are as the paper says, but for the values of `changed`, by a claim's name with underscores."""
    rng = np.random.default_rng(7)
    rows = []
    for variant in VARIANTS:
        own = {one.column: one.paper for one in VALUES if one.variant == variant}
        own |= {
            one.column: changed[key] for one in VALUES if one.variant == variant and (key := key_of(one)) in changed
        }
        for replicate in range(20):
            noise = rng.normal(1, 0.01)
            row = {column: own.get(column, DEFAULTS[column]) * noise for column in DEFAULTS}
            rows.append({"variant": variant, "replicate": replicate, "seed": 100 + replicate, **row})
    return pd.DataFrame(rows)


def key_of(one: paper_claims.Value) -> str:
    return one.name.replace(", ", "_").replace(" ", "_")


DEFAULTS = {
    paper_claims.WAITING: 42.0,
    paper_claims.MESSAGES: 9.0,
    paper_claims.FRAMES: 12.0,
    paper_claims.IN_TREES: 33.0,
    paper_claims.COVERED: 1521.0,
}


def paper_series(tau_s: dict[str, float]) -> pd.DataFrame:
    """Agents in trees that come to 10 with a time constant [s] per variant."""
    time_s = np.arange(0, 9000, 60.0)
    frames = [
        pd.DataFrame(
            {
                "variant": variant,
                "replicate": replicate,
                "time_s": time_s,
                "agents_in_trees": 10 * (1 - np.exp(-time_s / tau)),
            }
        )
        for variant, tau in tau_s.items()
        for replicate in range(3)
    ]
    return pd.concat(frames, ignore_index=True)


def test_each_claim_has_runs_in_the_sweep() -> None:
    """Every condition that a claim or a figure names is a variant of the built-in sweep `paper`."""
    named = {one.variant for one in VALUES} | {name for one in ORDERS for name in (one.less, one.more)}
    named |= {name for one in LIKENESSES for name in (one.one, one.other)} | set(LARGE_READINGS)
    named |= {variant for variants in FIGURES.values() for variant in variants}
    assert named <= set(VARIANTS)


def test_every_condition_is_shown_in_a_figure() -> None:
    """No run of the reproduction is done for nothing."""
    assert {variant for variants in FIGURES.values() for variant in variants} == set(VARIANTS)


def test_the_full_extent_is_the_papers() -> None:
    """20 replicates of 9000 s (Experimental Setup)."""
    assert (FULL.repeats, FULL.duration_s) == (20, 9000.0)


def test_tolerances_hold_the_papers_own_values() -> None:
    """A run that is as the paper's within every tolerance."""
    for one in VALUES:
        assert one.within[0] <= one.paper <= one.within[1], one.name


def test_values_as_the_papers_are_within() -> None:
    """Judged on a table made of the paper's own medians, every value claim holds."""
    found = judge(claims(paper_table(), pd.DataFrame(), convergence=False))
    values = {judgement.claim.name: judgement.verdict for judgement in found}
    assert {values[one.name] for one in VALUES} == {"holds"}


def test_a_value_outside_its_tolerance_does_not_hold_and_comes_first() -> None:
    """Moved out by a little more than the tolerance allows."""
    wrong = paper_table(waiting_time_hybrid_3=30.9)
    found = judge(claims(wrong, pd.DataFrame(), convergence=False))
    verdicts = {judgement.claim.name: judgement.verdict for judgement in found}
    assert verdicts["waiting time, hybrid 3"] == "does not hold"
    order = [judgement.verdict for judgement in found]
    assert order == sorted(order, key=["does not hold", "undecided", "holds"].index)


def test_the_papers_orders_hold_on_the_papers_values() -> None:
    """Where the paper's own medians differ by more than the noise put on them."""
    found = {j.claim.name: j for j in judge(claims(paper_table(), pd.DataFrame(), convergence=False))}
    assert found["hybrid 3 waits less than hierarchical"].verdict == "holds"
    assert found["hybrid 3 sends the operator less than hierarchical"].in_interval
    assert found["without recruitment waiting is at least 1.5 times as long"].verdict == "holds"


@pytest.mark.parametrize(("tau_s", "time_s"), [(200.0, 700.0), (1500.0, 3600.0)])
def test_convergence_is_read_off_the_series(tau_s: float, time_s: float) -> None:
    """A slow approach to 10 agents reaches 90 % of its end after about 2.3 time constants."""
    times = convergence_times_s(paper_series({"hybrid 3": tau_s}))
    assert times == pytest.approx([time_s] * 3, abs=320)
    assert times[0] >= tau_s * 2.0


def test_no_convergence_is_no_time() -> None:
    """Agents that never come into trees reach nothing; a series of zeros is there at once."""
    rows = paper_series({"hybrid 3": 1.0})
    rows["agents_in_trees"] = np.linspace(10, 0, 150).tolist() * 3
    assert all(time < 600 for time in convergence_times_s(rows))


def test_the_page_is_what_the_code_says() -> None:
    """CLAIMS.md is made by `claims_page`."""
    assert (ROOT / "CLAIMS.md").read_text() == claims_page()


def test_the_published_tests_are_what_the_published_table_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each p, effect size and reason in docs/reproduction/claims.csv and docs/REPRODUCTION.md."""
    monkeypatch.setattr(intervals, "RESAMPLES", 49)  # no interval is looked at
    table = pd.read_csv(ROOT / "docs" / "reproduction" / "table.csv")
    published = pd.read_csv(ROOT / "docs" / "reproduction" / "claims.csv").set_index("claim")
    page = (ROOT / "docs" / "REPRODUCTION.md").read_text()
    tested = [one for one in judge(claims(table, pd.DataFrame(), convergence=False)) if one.p is not None]
    assert len(tested) == published["p"].notna().sum()
    for one in tested:
        row = published.loc[one.claim.name]
        assert [row["p_holm"], row["effect"]] == pytest.approx([one.p_holm, one.effect])
        assert (row["verdict"], row["why"]) == (one.verdict, one.why)
        assert f"{one.why} |".replace("<", r"\<") in page


def test_known_failures_are_claims() -> None:
    """A remark on a claim that is not made would hide nothing, and mislead."""
    names = {one.name for one in (*VALUES, *ORDERS, *LIKENESSES)}
    names |= {f"{name}, {variant}" for variant in LARGE_READINGS for name, *_ in paper_claims.LARGE_VALUES}
    names |= {f"time to converge, {variant}" for variant, *_ in paper_claims.CONVERGENCE}
    assert set(REMARKS) <= names
