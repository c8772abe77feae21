"""Whether one thing changes what another does: found where it is, not found where it is not."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from deltaswarm_orchestrator.analysis.interaction import interactions
from deltaswarm_orchestrator.analysis.report import Notes, Table
from deltaswarm_orchestrator.analysis.sweep_report import sweep_report
from deltaswarm_orchestrator.sweeps.load import make_sweep

WAIT = "waiting_time_s.mean"
FACTORS = [["loss=0.0", "loss=0.1", "loss=0.3"], ["decentralised", "hybrid 3"]]


def a_table(hurt: float, repeats: int = 12) -> pd.DataFrame:
    """Loss lengthens waiting in every swarm, by 2 at most; in hybrid 3 `hurt` times as much at the most loss."""
    rng = np.random.default_rng(4)
    rows = []
    for loss, factor in zip(FACTORS[0], (1.0, 1.5, 2.0), strict=True):
        for mode, slow in (("decentralised", 40.0), ("hybrid 3", 25.0)):
            more = hurt if (loss, mode) == ("loss=0.3", "hybrid 3") else 1.0
            for replicate in range(repeats):
                wait = slow * factor * more * (1 + replicate / 10) * rng.normal(1, 0.02)
                rows.append({"variant": f"{loss}, {mode}", "replicate": replicate, "seed": replicate, WAIT: wait})
    return pd.DataFrame(rows)


def test_a_change_that_is_larger_in_one_of_them_is_found() -> None:
    """Not the change itself, which both have."""
    found = interactions(a_table(hurt=1.2), WAIT, FACTORS).set_index("change")
    assert list(found.index) == ["loss=0.0 to loss=0.1", "loss=0.0 to loss=0.3"]
    assert found["beside"].unique().tolist() == ["hybrid 3"]
    assert found["p_holm"].iloc[0] > 0.05
    assert found["p_holm"].iloc[1] < 0.01
    assert found["ratio"].tolist() == pytest.approx([1.0, 1.2], abs=0.05)
    assert found["ratio_low"].iloc[1] > 1


def test_a_change_that_is_as_large_in_both_is_none() -> None:
    """However large it is, and though the two differ from each other."""
    assert (interactions(a_table(hurt=1.0), WAIT, FACTORS)["p_holm"] > 0.05).all()


def test_what_has_no_ratio_has_no_row() -> None:
    """Zeros, as of the trees of a decentralised swarm; and replicates that did not see the same arrivals."""
    table = a_table(hurt=1.2)
    none = table.assign(**{WAIT: table[WAIT].where(~table["variant"].str.contains("dec"), 0.0)})
    assert interactions(none, WAIT, FACTORS).empty
    assert interactions(table.assign(seed=range(len(table))), WAIT, FACTORS).empty
    assert interactions(table[table["variant"] != "loss=0.3, hybrid 3"], WAIT, FACTORS).empty


def of_kind(manifest: dict[str, Any], table: pd.DataFrame, kind: type) -> list[Any]:
    return [block for block in sweep_report("x", manifest, table).sections[2].blocks if isinstance(block, kind)]


def test_the_report_of_two_things_swept_answers_whether_one_changes_the_other() -> None:
    """By what the sweep says of itself; where replicates are too few for an answer, that."""
    question = "Mean waiting time: is a change larger in one than in another?"
    (answered,) = [one for one in of_kind({"factors": FACTORS}, a_table(1.2), Table) if one.caption == question]
    assert [list(row)[:4] for row in answered.rows] == [
        ["loss=0.0 to loss=0.1", "hybrid 3", "decentralised", 12],
        ["loss=0.0 to loss=0.3", "hybrid 3", "decentralised", 12],
    ]
    assert answered.rows[1][4].startswith("1.2")
    for other in ({}, {"factors": FACTORS[:1]}, {"factors": [*FACTORS, ["a", "b"]]}):
        assert question not in [one.caption for one in of_kind(other, a_table(1.2), Table)]
    warnings = [one for one in of_kind({"factors": FACTORS}, a_table(1.2, repeats=3), Notes) if one.is_warning]
    assert len(warnings) == 2


def test_a_sweep_knows_what_varies_with_what() -> None:
    """The labels of the example in README.md; every variant's is one of each."""
    paired = {"label": ["decentralised", "hybrid 3"], "control.mode": ["decentralised", "hybrid"]}
    swept = {"axes": {"radio.loss": [0.0, 0.1, 0.3]}, "paired": [paired]}
    sweep = make_sweep({"schema": 1, "name": "loss", "base": "paper-25", "sweep": swept})
    assert sweep.factors == FACTORS
    assert [variant.label for variant in sweep.variants] == [f"{a}, {b}" for a in FACTORS[0] for b in FACTORS[1]]
