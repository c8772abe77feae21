"""Every number and every claim of the paper's Results (Kelly et al.), beside our runs.

A tolerance is the range that this project promises for its own median (CLAIMS.md); where it promises none,
the paper's median and interquartile range.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.analysis.claims import Claim, EquivalenceClaim, OrderClaim, ValueClaim
from deltaswarm_orchestrator.analysis.statistics import samples
from deltaswarm_orchestrator.reproduction.conditions import (
    DECENTRALISED,
    HIERARCHICAL,
    HYBRID,
    HYBRID_2,
    HYBRID_4,
    HYBRID_10,
    LARGE,
    LARGE_READINGS,
    NO_DISSOLUTION,
    NO_RECRUITMENT,
)

WAITING, MESSAGES = "waiting_time_s.mean", "operator_messages_per_s.mean"
FRAMES, IN_TREES = "frames_sent_per_s.mean", "agents_in_trees.mean"
COVERED = "covered_area_m2.mean_while_trees"

PERFORMANCE, SCALABILITY = "Performance of swarm coordination", "Scalability"
ABLATION, SENSITIVITY = "Ablation study", "Sensitivity to delta"
BEST = "best for delta 3 and 4"


@dataclass(frozen=True)
class Value:
    """A number that the paper gives for one condition."""

    name: str
    source: str
    variant: str
    column: str
    paper: float
    unit: str
    within: tuple[float, float]


@dataclass(frozen=True)
class Order:
    """Two conditions of which the paper says that one has less."""

    name: str
    source: str
    text: str
    less: str
    more: str
    column: str
    at_least_ratio: float | None = None
    paper_ratio: float | None = None


@dataclass(frozen=True)
class Likeness:
    """Two conditions that the paper calls close; how close is our reading."""

    name: str
    source: str
    text: str
    one: str
    other: str
    column: str
    margin: float
    unit: str


VALUES = (
    Value("waiting time, decentralised", PERFORMANCE, DECENTRALISED, WAITING, 42.1, "s", (38.0, 46.0)),
    Value("waiting time, hierarchical", PERFORMANCE, HIERARCHICAL, WAITING, 34.0, "s", (22.0, 46.0)),
    Value("waiting time, hybrid 3", PERFORMANCE, HYBRID, WAITING, 26.4, "s", (23.0, 30.0)),
    Value("waiting time, no recruitment", ABLATION, NO_RECRUITMENT, WAITING, 45.9, "s", (37.1, 54.7)),
    Value("waiting time, no dissolution", ABLATION, NO_DISSOLUTION, WAITING, 27.6, "s", (16.8, 38.4)),
    Value("operator messages, decentralised", SENSITIVITY, DECENTRALISED, MESSAGES, 9.9, "1/s", (9.5, 10.3)),
    Value("operator messages, hierarchical", SENSITIVITY, HIERARCHICAL, MESSAGES, 4.5, "1/s", (4.08, 4.92)),
    Value(
        "operator messages, hierarchical read as hybrid 2", SENSITIVITY, HYBRID_2, MESSAGES, 4.5, "1/s", (4.08, 4.92)
    ),
    Value("operator messages, hybrid 3", SENSITIVITY, HYBRID, MESSAGES, 3.9, "1/s", (3.4, 4.4)),
    Value("agents in trees, 25 agents", SCALABILITY, HYBRID, IN_TREES, 12.0, "", (11.0, 13.5)),
    Value("area covered, 25 agents", SCALABILITY, HYBRID, COVERED, 672.0, "m²", (605.0, 739.0)),
)

ORDERS = (
    Order(
        "hierarchical waits less than decentralised",
        PERFORMANCE,
        "19.2 % less",
        HIERARCHICAL,
        DECENTRALISED,
        WAITING,
        paper_ratio=42.1 / 34.0,
    ),
    Order(
        "hybrid 3 waits less than decentralised",
        PERFORMANCE,
        "37 % less",
        HYBRID,
        DECENTRALISED,
        WAITING,
        paper_ratio=42.1 / 26.4,
    ),
    Order(
        "hybrid 3 waits less than hierarchical",
        PERFORMANCE,
        "22 % less",
        HYBRID,
        HIERARCHICAL,
        WAITING,
        paper_ratio=34.0 / 26.4,
    ),
    Order(
        "without recruitment waiting is at least 1.5 times as long",
        ABLATION,
        "73 % more",
        HYBRID,
        NO_RECRUITMENT,
        WAITING,
        at_least_ratio=1.5,
        paper_ratio=45.9 / 26.4,
    ),
    Order(
        "without dissolution waiting is longer",
        ABLATION,
        "5 % more",
        HYBRID,
        NO_DISSOLUTION,
        WAITING,
        paper_ratio=27.6 / 26.4,
    ),
    Order(
        "hybrid 3 sends the operator less than half of decentralised",
        SENSITIVITY,
        "over 50 % less",
        HYBRID,
        DECENTRALISED,
        MESSAGES,
        at_least_ratio=2.0,
        paper_ratio=9.9 / 3.9,
    ),
    Order(
        "hierarchical sends the operator less than half of decentralised",
        SENSITIVITY,
        "over 50 % less",
        HIERARCHICAL,
        DECENTRALISED,
        MESSAGES,
        at_least_ratio=2.0,
        paper_ratio=9.9 / 4.5,
    ),
    Order(
        "hybrid 3 sends the operator less than hierarchical",
        SENSITIVITY,
        "3.9 against 4.5 per s",
        HYBRID,
        HIERARCHICAL,
        MESSAGES,
        paper_ratio=4.5 / 3.9,
    ),
    Order(
        "a smaller delta sends the operator more: hybrid 2 above hybrid 3",
        SENSITIVITY,
        "more leaders",
        HYBRID,
        HYBRID_2,
        MESSAGES,
    ),
    Order(
        "hybrid 3 sends more frames than decentralised",
        SENSITIVITY,
        "as in its figure",
        DECENTRALISED,
        HYBRID,
        FRAMES,
    ),
    Order(
        "hierarchical sends more frames than hybrid 3",
        SENSITIVITY,
        "as in its figure",
        HYBRID,
        HIERARCHICAL,
        FRAMES,
    ),
    Order("delta 3 waits less than delta 2", SENSITIVITY, BEST, HYBRID, HYBRID_2, WAITING),
    Order("delta 3 waits less than delta 5", SENSITIVITY, BEST, HYBRID, "hybrid 5", WAITING),
    Order("delta 4 waits less than delta 7", SENSITIVITY, BEST, HYBRID_4, "hybrid 7", WAITING),
    Order("delta 4 waits less than delta 10", SENSITIVITY, BEST, HYBRID_4, HYBRID_10, WAITING),
)

LIKENESSES = (
    Likeness(
        "delta 10 waits as decentralised does",
        SENSITIVITY,
        "closer to decentralised as delta grows",
        HYBRID_10,
        DECENTRALISED,
        WAITING,
        4.0,
        "s",
    ),
    Likeness(
        "without recruitment waiting is as decentralised",
        ABLATION,
        "45.9 s is close to 42.7 s",
        NO_RECRUITMENT,
        DECENTRALISED,
        WAITING,
        5.0,
        "s",
    ),
)

LARGE_VALUES = (
    ("agents in trees after 6000 s", "agents_in_trees", 33.0, "", (29.0, 37.0)),
    ("area covered", COVERED, 1521.0, "m²", (1369.0, 1673.0)),
)
"""For each reading of the scaled swarm: name, column of the table or the series, paper, unit, tolerance."""

CONVERGENCE = ((HYBRID, 1000.0, (0.0, 1000.0)), (LARGE, 6000.0, (4500.0, 7500.0)))
"""When the number of agents in trees has converged: variant, the paper's words read as a number, tolerance [s]."""

CONVERGED_S = 6000.0
"""Of the scaled swarm, numbers after this time are given apart."""

_TWICE = (
    "With 0.2 events per s half of the agents are in trees, and they cover more; the paper's numbers fit 0.1 per s."
)

REMARKS = {
    "waiting time, no dissolution": (
        "Without dissolution 24 of 25 agents end up in one large tree, and how long events wait depends on where it "
        "happens to stand: from 14 to 97 s over 20 replicates. That dissolution helps holds, by more than in the paper."
    ),
    "hybrid 3 sends the operator less than hierarchical": (
        "In a hierarchical swarm only roots report, since free agents do not work: 4.2 messages per s, as many as "
        'hybrid 3 sends. If the paper\'s "hierarchical delta = 2" is read as hybrid 2, it holds: 4.6 against 4.3.'
    ),
    "delta 3 waits less than delta 5": (
        "Delta 3, 4 and 5 cannot be told apart by 20 replicates: the medians are 25.8, 25.2 and 25.3 s."
    ),
    "time to converge, hybrid 3": (
        "The number of agents in trees rises quickly until about 600 s and slowly from there on; the paper does not "
        "say how it reads convergence off, we take 90 % of the mean of the last third."
    ),
    f"time to converge, {LARGE}": (
        "By the same criterion; the number goes on rising slowly and passes 30 at about 6000 s, as in the paper."
    ),
    "area covered, 100 agents, 100 I, 0.1 per s": "Where events are closer together, so are the trees: 200 I fits.",
    "agents in trees after 6000 s, 100 agents, 200 I, 0.2 per s": _TWICE,
    "area covered, 100 agents, 200 I, 0.2 per s": _TWICE,
    "agents in trees after 6000 s, 100 agents, 100 I, 0.2 per s": _TWICE,
    "area covered, 100 agents, 100 I, 0.2 per s": _TWICE,
}
"""Claims that do not hold in our runs, with the reason as far as we know it."""


def claims(table: pd.DataFrame, series: pd.DataFrame, *, convergence: bool) -> list[Claim]:
    """All claims for which the table has the variants; `convergence` for those that only whole runs can show."""
    there = set(table["variant"])

    found: list[Claim] = [
        ValueClaim(one.name, one.source, one.paper, one.unit, values_of(table, one.variant, one.column), one.within)
        for one in VALUES
        if one.variant in there
    ]
    for order in ORDERS:
        if {order.less, order.more} <= there:
            pair = samples(table, order.column, order.less, order.more)
            found.append(
                OrderClaim(
                    order.name,
                    order.source,
                    order.text,
                    pair.a,
                    pair.b,
                    pair.paired,
                    order.at_least_ratio,
                    paper_ratio=order.paper_ratio,
                )
            )
    for like in LIKENESSES:
        if {like.one, like.other} <= there:
            pair = samples(table, like.column, like.one, like.other)
            found.append(
                EquivalenceClaim(like.name, like.source, like.text, pair.a, pair.b, like.margin, like.unit, pair.paired)
            )
    if convergence:
        found += _of_convergence(table, series)
    return found


def _of_convergence(table: pd.DataFrame, series: pd.DataFrame) -> Iterator[Claim]:
    """What the paper says of long runs: where 100 agents converge to, and when."""
    there = set(table["variant"])
    for variant in (variant for variant in LARGE_READINGS if variant in there):
        for name, column, paper, unit, within in LARGE_VALUES:
            values = series_means(series, variant, column) if column in series else values_of(table, variant, column)
            yield ValueClaim(f"{name}, {variant}", SCALABILITY, paper, unit, values, within)
    for variant, paper, within in CONVERGENCE:
        if variant in there:
            times = convergence_times_s(series[series["variant"] == variant])
            yield ValueClaim(f"time to converge, {variant}", SCALABILITY, paper, "s", times, within)


def values_of(table: pd.DataFrame, variant: str, column: str) -> list[float]:
    """One figure of a condition, replicate by replicate."""
    return [float(value) for value in table.loc[table["variant"] == variant, column]]


def series_means(series: pd.DataFrame, variant: str, column: str) -> list[float]:
    """Means of a column after convergence, replicate by replicate."""
    late = series[(series["variant"] == variant) & (series["time_s"] >= CONVERGED_S)]
    return [float(mean) for mean in late.groupby("replicate")[column].mean()]


def convergence_times_s(series: pd.DataFrame, share: float = 0.9, smooth_s: float = 600.0) -> list[float]:
    """Per replicate when the number of agents in trees first reaches 90 % of its mean over the last third [s].

    The paper gives no criterion; this one reads a mean over 10 minutes, since single windows go up and down.
    """
    times = []
    for _, rows in series.groupby("replicate"):
        ordered = rows.sort_values("time_s")
        time_s, values = ordered["time_s"].to_numpy(float), ordered["agents_in_trees"].to_numpy(float)
        window = max(1, round(smooth_s / (time_s[1] - time_s[0])))
        smooth = np.convolve(values, np.ones(window) / window, mode="valid")
        goal = share * values[len(values) * 2 // 3 :].mean()
        reached = np.nonzero(smooth >= goal)[0]
        times.append(float(time_s[reached[0] + window // 2]) if len(reached) else np.nan)
    return times
