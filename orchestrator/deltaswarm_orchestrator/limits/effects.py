"""What a limit does to a mode, what sets the modes apart under it, and whether either is more than chance."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.analysis.statistics import Comparison, compare, describe, holm, samples
from deltaswarm_orchestrator.limits.experiments import MODES, PAIRS, Experiment, Level
from deltaswarm_orchestrator.limits.runs import MEASURES, MESSAGES, WAITING

ALPHA = 0.05

LIMIT, BETWEEN, HARM = "against no limit", "between modes", "harm"
"""The questions: a mode with the limit against the same without; two modes at one level; whether the limit changes
one mode more than another (the ratios of the first question, replicate by replicate)."""

_KEPT = ("n_a", "ratio", "ratio_low", "ratio_high", "difference", "low", "high", "test", "p", "effect")


def estimates_of(experiment: Experiment, runs: pd.DataFrame) -> pd.DataFrame:
    """Median with its interval of each measure, a row per measure, mode and level; of values that are there."""
    rows = []
    for measure in MEASURES:
        for mode in MODES:
            for level in experiment.levels:
                values = runs.loc[(runs["mode"] == mode) & (runs["level"] == level.label), measure]
                found = describe(values)
                head = {"experiment": experiment.name, "measure": measure, "mode": mode, "level": level.label}
                rows.append({**head, "value": found.median, "low": found.low, "high": found.high, "n": found.n})
    return pd.DataFrame(rows)


def comparisons_of(experiment: Experiment, runs: pd.DataFrame) -> pd.DataFrame:
    """All comparisons of an experiment, paired by replicate.

    p is corrected (Holm) over the tests of one question and one measure; over more, ten replicates could show
    nothing.

    Returns:
        One row per comparison: experiment, question, measure, level, `a` against `b` (modes), n pairs, the ratio of
        the medians a / b and the difference, each with its interval, p, p_holm and the effect size. Of HARM the
        ratio is that of a's ratios (limit / no limit) to b's.
    """
    labelled = runs.assign(variant=runs["level"] + ", " + runs["mode"])
    rows: list[dict[str, Any]] = []
    for measure in (WAITING, MESSAGES):
        for question, found in (
            (LIMIT, _against_no_limit(experiment, labelled, measure)),
            (BETWEEN, _between_modes(experiment, labelled, measure)),
            (HARM, _harm(experiment, labelled, measure)),
        ):
            family = list(found)
            adjusted = holm([compared.p for _, _, _, compared in family])
            for (level, a, b, compared), p_holm in zip(family, adjusted, strict=True):
                own = asdict(compared)
                rows.append(
                    {
                        "experiment": experiment.name,
                        "question": question,
                        "measure": measure,
                        "level": level.label,
                        "a": a,
                        "b": b,
                        **{name: own[name] for name in _KEPT},
                        "p_holm": p_holm,
                    }
                )
    return pd.DataFrame(rows).rename(columns={"n_a": "n"})


_Compared = Iterator[tuple[Level, str, str, Comparison]]


def _against_no_limit(experiment: Experiment, runs: pd.DataFrame, measure: str) -> _Compared:
    for mode in MODES:
        for level in experiment.levels[1:]:
            found = samples(runs, measure, f"{level.label}, {mode}", f"{experiment.base.label}, {mode}")
            yield level, mode, mode, compare(found.a, found.b, paired=found.paired)


def _between_modes(experiment: Experiment, runs: pd.DataFrame, measure: str) -> _Compared:
    for level in experiment.levels:
        for a, b in PAIRS:
            found = samples(runs, measure, f"{level.label}, {a}", f"{level.label}, {b}")
            yield level, a, b, compare(found.a, found.b, paired=found.paired)


def _harm(experiment: Experiment, runs: pd.DataFrame, measure: str) -> _Compared:
    values = runs.pivot_table(index="replicate", columns="variant", values=measure, dropna=False)
    for level in experiment.harder:
        for a, b in PAIRS:
            ratios = []
            for mode in (a, b):
                without = values[f"{experiment.base.label}, {mode}"]
                ratios.append(values[f"{level.label}, {mode}"] / without.where(without > 0))
            yield level, a, b, compare(ratios[0], ratios[1], paired=True)
