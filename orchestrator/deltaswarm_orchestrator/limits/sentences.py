"""Findings as sentences: what is shown, by how much; and what is not shown, said so."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.analysis import words
from deltaswarm_orchestrator.analysis.ranks import smallest_p
from deltaswarm_orchestrator.limits.effects import ALPHA, BETWEEN, HARM, LIMIT
from deltaswarm_orchestrator.limits.experiments import MODES, PAIRS, Experiment, Level
from deltaswarm_orchestrator.limits.findings import Findings
from deltaswarm_orchestrator.limits.recovery import TOLERANCE
from deltaswarm_orchestrator.limits.runs import BIN_S, MESSAGES, WAITING
from deltaswarm_orchestrator.reproduction.conditions import DECENTRALISED, HYBRID

Row = Mapping[Any, Any]

CLAUSES = {
    WAITING: ("events wait longer", "events wait less", "no change of waiting is shown"),
    MESSAGES: ("the operator gets more messages", "the operator gets fewer messages", "no change of messages is shown"),
}
"""More, less, and neither."""


def row_of(found: Findings, experiment: Experiment, question: str, measure: str, level: Level, a: str, b: str) -> Row:
    """One comparison."""
    tests = found.comparisons
    wanted = {"experiment": experiment.name, "question": question, "measure": measure, "level": level.label}
    for column, value in {**wanted, "a": a, "b": b}.items():
        tests = tests[tests[column] == value]
    return dict(tests.iloc[0])


def direction(row: Row) -> int:
    """1 where `a` is shown to be larger, -1 smaller, 0 neither."""
    if not float(row["p_holm"]) < ALPHA or pd.isna(row["difference"]) or row["difference"] == 0:
        return 0
    return 1 if float(row["difference"]) > 0 else -1


def size(row: Row, unit: str = "") -> str:
    """`1.32 times [1.20, 1.44]`; the difference in its unit where a ratio makes no sense, as with no messages."""
    if not pd.isna(row["ratio"]):
        return f"{words.with_interval(row['ratio'], row['ratio_low'], row['ratio_high'], 2)} times"
    if pd.isna(row["difference"]):
        return "nothing to compare"
    return f"{words.with_interval(row['difference'], row['low'], row['high'])}{unit}"


def tested(row: Row) -> str:
    """The p-value, corrected."""
    return words.p_equals(float(row["p_holm"]))


def effect_of(found: Findings, experiment: Experiment, mode: str) -> str:
    """What a limit does to a mode: at which levels waiting and messages change, and by how much at the hardest."""
    parts = []
    for measure, unit in ((WAITING, " s"), (MESSAGES, " per s")):
        rows = {
            level.label: row_of(found, experiment, LIMIT, measure, level, mode, mode) for level in experiment.levels[1:]
        }
        more, less, neither = CLAUSES[measure]
        clauses = [
            f"{clause} {listed(where)}"
            for sign, clause in ((1, more), (-1, less))
            if (where := [level.words for level in experiment.levels[1:] if direction(rows[level.label]) == sign])
        ]
        row = rows[experiment.hardest.label]
        parts.append(f"{', '.join(clauses) or neither} (at the hardest level {size(row, unit)}, {tested(row)})")
    return f"{mode}: {'; '.join(parts)}."


def listed(names: Sequence[str]) -> str:
    """`a, b and c`."""
    return ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]


def paying(found: Findings, experiment: Experiment) -> tuple[Level | None, Level | None]:
    """The first level from which on hybrid 3 is not shown to wait less than decentralised; and to wait longer.

    From a level on: at it and at all harder ones. Without the limit counts as the mildest level.
    """
    signs = [
        (level, direction(row_of(found, experiment, BETWEEN, WAITING, level, HYBRID, DECENTRALISED)))
        for level in (experiment.base, *experiment.harder)
    ]
    return _from_where(signs, (0, 1)), _from_where(signs, (1,))


def _from_where(signs: list[tuple[Level, int]], wanted: tuple[int, ...]) -> Level | None:
    first = None
    for level, sign in reversed(signs):
        if sign not in wanted:
            break
        first = level
    return first


def paying_in_words(found: Findings, experiment: Experiment) -> str:
    """From where on hybrid 3 stops paying."""
    stops, loses = paying(found, experiment)
    row = row_of(found, experiment, BETWEEN, WAITING, experiment.hardest, HYBRID, DECENTRALISED)
    detail = f"{experiment.hardest.words} it is {size(row, ' s')} against decentralised, {tested(row)}"
    if stops is None:
        return f"Hybrid 3's waiting is shorter than decentralised's to the end: {detail}."
    beyond = "" if (loses or stops) is experiment.hardest else " and beyond"
    if loses is not None:
        return f"Hybrid 3's waiting is longer than decentralised's {loses.words}{beyond}: {detail}."
    where = "at no level, not even without the limit" if stops is experiment.base else f"no more {stops.words}{beyond}"
    return (
        f"That hybrid 3's waiting is shorter than decentralised's is shown {where}: {detail}. That is no proof that "
        "they wait alike."
    )


def harm_in_words(found: Findings, experiment: Experiment, measure: str) -> str:
    """Which mode the hardest level changes more than which other."""
    rows = [row_of(found, experiment, HARM, measure, experiment.hardest, a, b) for a, b in PAIRS]
    shown = [
        f"more in {row['a' if sign > 0 else 'b']} than in {row['b' if sign > 0 else 'a']} ({tested(row)})"
        for row in rows
        if (sign := direction(row))
    ]
    subject = "Waiting times" if measure == WAITING else "Messages to the operator"
    if not shown:
        return f"{subject}: that the limit changes one mode more than another is not shown."
    return f"{subject} grow (or shrink less), {experiment.hardest.words}: {'; '.join(shown)}."


def duration(seconds: float) -> str:
    """A time to come back, for a table: `300 s`, `not by the end`, `-`."""
    if math.isnan(seconds):
        return words.MISSING
    return "not by the end" if math.isinf(seconds) else f"{seconds:.0f} s"


def back_in_words(row: Row) -> str:
    """`hybrid 3 within 600 s (95 % interval 300 s to not by the end)`."""
    at, low, high = (float(row[name]) for name in ("back_s", "low_s", "high_s"))
    if math.isnan(at):
        return f"{row['mode']}: not known"
    within = duration(at) if math.isinf(at) else f"within {duration(at)}"
    if math.isnan(low):
        return f"{row['mode']} {within}"
    return f"{row['mode']} {within} (95 % interval {duration(low)} to {duration(high)})"


def recoveries(found: Findings, experiment: Experiment, measure: str, level: Level, reference: Level) -> list[Row]:
    """How each mode came back, a row each."""
    rows = found.recovery
    wanted = {"experiment": experiment.name, "measure": measure, "level": level.label, "reference": reference.label}
    for column, value in wanted.items():
        rows = rows[rows[column] == value]
    order = {mode: place for place, mode in enumerate(MODES)}
    return sorted((dict(row) for _, row in rows.iterrows()), key=lambda row: order[str(row["mode"])])


def recovery_in_words(found: Findings, experiment: Experiment) -> list[str]:
    """How the modes came back from the hardest level, as to waiting."""
    lines = []
    for reference in (experiment.base, *(level for level in experiment.levels if level.is_beside)):
        rows = recoveries(found, experiment, WAITING, experiment.hardest, reference)
        against = "" if reference is experiment.base else f", held against swarms {reference.words}"
        lines.append(
            f"Waiting is back (within {TOLERANCE:g} times, by windows of {BIN_S:g} s) {experiment.hardest.words}"
            f"{against}: {'; '.join(map(back_in_words, rows))}."
        )
    return lines


def too_few(found: Findings) -> list[str]:
    """Of which experiments some or all differences of waiting could not be significant, however large."""
    in_all, in_some = [], []
    for experiment in found.experiments:
        can_show = [could_show(found, experiment, question) for question in (LIMIT, BETWEEN, HARM)]
        if not any(can_show):
            in_all.append(experiment.title.lower())
        elif not all(can_show):
            in_some.append(experiment.title.lower())
    lines = []
    if in_all:
        lines.append(
            f"There are too few replicates for any difference, however large, to be significant in the runs of "
            f"{listed(in_all)}: that something is not shown there says nothing."
        )
    if in_some:
        lines.append(f"There are too few replicates for a difference to show in some questions of {listed(in_some)}.")
    return lines


def could_show(found: Findings, experiment: Experiment, question: str) -> bool:
    """Whether there are replicates enough for a difference of waiting to be significant, were it large enough."""
    rows = found.comparisons
    rows = rows[(rows["experiment"] == experiment.name) & (rows["measure"] == WAITING) & (rows["question"] == question)]
    n = int(rows["n"].max())
    return smallest_p(n, n, paired=True) * len(rows) < ALPHA
