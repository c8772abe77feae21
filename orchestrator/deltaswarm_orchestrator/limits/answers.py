"""The answer to the paper's open question, in five sentences, and the bar for loss; made from the numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from deltaswarm_orchestrator.analysis import words
from deltaswarm_orchestrator.limits.effects import BETWEEN, LIMIT
from deltaswarm_orchestrator.limits.experiments import (
    LOSS,
    LOSS_BAR,
    LOSS_BAR_LEVEL,
    MODES,
    Experiment,
    Level,
)
from deltaswarm_orchestrator.limits.findings import Findings
from deltaswarm_orchestrator.limits.runs import MESSAGES, WAITING
from deltaswarm_orchestrator.limits.sentences import (
    Row,
    back_in_words,
    could_show,
    direction,
    listed,
    paying,
    recoveries,
    row_of,
)
from deltaswarm_orchestrator.reproduction.conditions import DECENTRALISED, HYBRID


def answer(found: Findings) -> list[str]:
    """Five sentences: what makes events wait, where hybrid stops paying, the operator, recovery, what is not shown."""
    return [_waiting(found), _paying(found), _operator(found), _recovery(found), _not_shown(found)]


def _waiting(found: Findings) -> str:
    worst = "; ".join(_worst(found, mode, WAITING, "wait longer") for mode in MODES)
    return f"What makes events wait longer most, at the hardest level tried: {worst}."


def _worst(found: Findings, mode: str, measure: str, verb: str) -> str:
    """The limit that raises a measure of a mode most, of those that are shown to raise it."""
    rows: list[tuple[float, Experiment]] = []
    for experiment in found.experiments:
        row = row_of(found, experiment, LIMIT, measure, experiment.hardest, mode, mode)
        if direction(row) > 0 and not pd.isna(row["ratio"]):
            rows.append((float(row["ratio"]), experiment))
    if not rows:
        return f"{mode} is not shown to {verb} under any limit"
    ratio, experiment = max(rows, key=lambda pair: pair[0])
    return f"{mode} {experiment.hardest.words} ({words.number(ratio, 2)} times)"


def _paying(found: Findings) -> str:
    pays, stops, never, loses, unknown = [], [], [], [], []
    for experiment in found.experiments:
        if not could_show(found, experiment, BETWEEN):
            unknown.append(experiment.title.lower())
            continue
        stopped, lost = paying(found, experiment)
        if stopped is experiment.base:
            never.append(experiment.title.lower())
        elif lost is not None:
            loses.append(lost.words)
        elif stopped is not None:
            stops.append(stopped.words)
        else:
            pays.append(experiment.title.lower())
    parts = []
    if pays:
        parts.append(f"pays, that is, its events wait less than a decentralised swarm's, to the end of {listed(pays)}")
    if stops:
        parts.append(f"is no longer shown to pay {listed(stops)}")
    if never:
        parts.append(f"is not shown to pay, not even without the limit, in the runs of {listed(never)}")
    if loses:
        parts.append(f"waits longer than decentralised {listed(loses)}")
    if unknown:
        parts.append(f"has too few replicates to show whether it pays in the runs of {listed(unknown)}")
    return f"Hybrid 3 {'; it '.join(parts)}."


def _operator(found: Findings) -> str:
    worst = "; ".join(_worst(found, mode, MESSAGES, "send more") for mode in MODES)
    fewer = [
        experiment
        for experiment in found.experiments
        if direction(row_of(found, experiment, BETWEEN, MESSAGES, experiment.hardest, HYBRID, DECENTRALISED)) < 0
    ]
    count = f"{len(fewer)} of {words.count(len(found.experiments), 'limit')}"
    return (
        f"The operator gets more messages than without a limit above all: {worst}; hybrid 3 still sends fewer than "
        f"decentralised at the hardest level of {count}."
    )


def _recovery(found: Findings) -> str:
    deaths = [one for one in found.experiments if one.fault is not None and one.fault.until_s is None]
    if not deaths:
        return "No loss of agents was tried, so nothing is said of how a swarm comes back from one."
    parts = []
    for experiment in deaths:
        rows = recoveries(found, experiment, WAITING, experiment.hardest, experiment.base)
        rows = [row for row in rows if experiment.name != "lose-the-roots" or row["mode"] != DECENTRALISED]
        parts.append(f"{experiment.hardest.words} {', '.join(map(back_in_words, rows))}")
    return f"Waiting comes back to what it would have been: {'; '.join(parts)}."


def _not_shown(found: Findings) -> str:
    quiet = []
    total = 0
    for experiment in found.experiments:
        rows = [row_of(found, experiment, LIMIT, WAITING, experiment.hardest, mode, mode) for mode in MODES]
        total += len(rows)
        unchanged = [mode for mode, row in zip(MODES, rows, strict=True) if direction(row) == 0]
        if len(unchanged) == len(MODES):
            quiet.append((f"{experiment.title.lower()} (all modes)", len(unchanged)))
        elif unchanged:
            quiet.append((f"{experiment.title.lower()} ({listed(unchanged)})", len(unchanged)))
    count = sum(number for _, number in quiet)
    named = f": {'; '.join(text for text, _ in quiet)}" if quiet else ""
    return (
        f"At the hardest level {count} of {total} changes of waiting are not significant (5 %, Holm within each "
        f"experiment){named}."
    )


@dataclass(frozen=True)
class Bar:
    """Whether hybrid 3 bears the loss that it shall bear."""

    level: Level
    row: Row

    @property
    def holds(self) -> bool:
        """Whether the ratio of the medians is at most LOSS_BAR; not, if it is unknown."""
        return not pd.isna(self.row["ratio"]) and bool(self.row["ratio"] <= LOSS_BAR)

    def text(self, others: Sequence[str]) -> str:
        """In words, with what it is at the other levels."""
        verdict = "holds" if self.holds else "does not hold"
        ratio = words.with_interval(self.row["ratio"], self.row["ratio_low"], self.row["ratio_high"], 2)
        beside = f" Beside it: {'; '.join(others)}." if others else ""
        return (
            f"The bar for loss {verdict}: {self.level.words} hybrid 3 waits {ratio} times as "
            f"long as without, over {int(self.row['n'])} seeds; at most {LOSS_BAR:g} times is asked for.{beside}"
        )


def loss_bar(found: Findings) -> Bar | None:
    """The bar, if loss was tried."""
    experiment = _loss(found)
    if experiment is None:
        return None
    level = next(one for one in experiment.levels if one.value == LOSS_BAR_LEVEL)
    return Bar(level, row_of(found, experiment, LIMIT, WAITING, level, HYBRID, HYBRID))


def loss_bar_in_words(found: Findings) -> list[str]:
    """The bar in words; nothing if loss was not tried."""
    experiment, bar = _loss(found), loss_bar(found)
    if experiment is None or bar is None:
        return []
    others = []
    for level in experiment.harder:
        if level.value != LOSS_BAR_LEVEL:
            row = row_of(found, experiment, LIMIT, WAITING, level, HYBRID, HYBRID)
            others.append(f"{words.with_interval(row['ratio'], row['ratio_low'], row['ratio_high'], 2)} {level.words}")
    return [bar.text(others)]


def _loss(found: Findings) -> Experiment | None:
    return next((experiment for experiment in found.experiments if experiment.name == LOSS), None)
