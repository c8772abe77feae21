"""The parts of pages that tell of studies, from tables whose answers are counted by hand."""

from pathlib import Path

import pytest
from docs.extensions import published

ESTIMATES = """\
variant,metric,median,low,high
"few, rule",rate_hz,2.04,,
"few, rule",completion_s,150.0,140,160
"few, slow",rate_hz,1.5,,
"few, slow",completion_s,200.0,190,210
"few, soon",rate_hz,2.0,,
"few, soon",completion_s,120.0,110,130
"few, loud",rate_hz,2.01,,
"few, loud",completion_s,90.0,80,100
"many, rule",rate_hz,1.9,,
"many, rule",completion_s,300.0,280,310
"many, slow",rate_hz,2.5,,
"many, slow",completion_s,250.0,240,260
"many, soon",rate_hz,4.0,,
"many, soon",completion_s,180.0,170,190
"many, loud",rate_hz,9.0,,
"many, loud",completion_s,100.0,90,110
"""

CLAIMS = """\
claim,source,calibrated,verdict
a,paper,,holds
b,paper,,agrees
c,paper,,differs
d,paper,,undecided
e,paper,radio.range_m,refuted
f,Our readings,,refuted
g,Our readings,radio.range_m,holds
h,paper,,depends on the metric
i,paper,radio.range_m,agrees
"""

LINES = """\
verdicts = ["holds", "refuted", "depends", "undecided"]
headline = {}
lines = [
    "{main}: {main_holds} {main_refuted} {main_depends} {main_undecided}",
    "{calibrated}: {calibrated_holds} {calibrated_refuted}; {ours}: {ours_holds} {ours_refuted}",
]
"""

KEYS = """\
claim,title,rho_holds,share_low,share_high,verdict
faster,radio range,0.3,0.41,0.92,turns it
faster,event rate,-0.6,0.9,0.2,turns it
faster,speed,0.7,0.1,0.9,neither
quieter,speed,0.1,0.5,0.6,neither
"""

SHARES = """\
claim,text,share,low,high
faster,Trees wait less,0.75,0.7,0.8
quieter,Trees report less,1.0,0.99,1.0
"""


BEST = """\
study = "made-up"
cells = ["few", "many"]
fixed = ["slow", "soon", "loud"]
rate = "rate_hz"
by = "completion_s"
rules = { rule = 2.0 }
columns = { rate_hz = "rate [1/s]", completion_s = "completion [s]" }
"""


@pytest.fixture
def studies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One study, `made-up`, whose tables are those above, and a table of the same name that a page shows."""
    tables = {"estimates": ESTIMATES, "claims": CLAIMS, "keys": KEYS, "shares": SHARES}
    (tmp_path / "made-up").mkdir()
    for name, table in tables.items():
        (tmp_path / "made-up" / f"{name}.csv").write_text(table)
    (tmp_path / "made-up.toml").write_text(BEST)
    (tmp_path / "verdicts.toml").write_text(LINES)
    monkeypatch.setattr(published, "STUDIES", tmp_path)
    monkeypatch.setattr(published, "TABLES", tmp_path)


@pytest.mark.usefixtures("studies")
def test_the_best_fixed_variant_is_the_soonest_within_the_bound() -> None:
    """A rate that equals the bound is within it, a sooner variant above it is out, and a cell may have none."""
    rows = [line for line in published.best("made-up") if line.startswith(("| few", "| many"))]
    assert rows == [
        "| few, rule | 2.04 | 150 | few, soon | 2 | 120 |",
        "| many, rule | 1.9 | 300 | none |  |  |",
    ]


@pytest.mark.usefixtures("studies")
def test_verdicts_are_counted_without_calibrated_claims_and_those_of_ours() -> None:
    """A number that agrees holds, and one that differs is refuted."""
    assert [*published.verdicts("made-up")] == ["", "- 5: 2 1 1 1", "- 2: 1 1; 2: 1 1", ""]


@pytest.mark.usefixtures("studies")
def test_keys_that_turn_a_claim_stand_in_the_order_of_their_strength() -> None:
    """With the shares of both ends, and without keys that do not turn it."""
    rows = [line for line in published.shares("made-up") if line.startswith("| Trees")]
    assert rows == [
        "| Trees wait less | 75 [70, 80] | event rate (90, 20); radio range (41, 92) |",
        "| Trees report less | 100 [99, 100] | no significant key |",
    ]
