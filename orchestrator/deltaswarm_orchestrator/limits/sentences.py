"""Findings as sentences: what is shown, by how much; and what is not shown, said so."""

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.analysis import words
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
    return f"{words.with_interval(row['difference'], row['low'], row['high'])}{unit} apart"


def tested(row: Row) -> str:
    """The p-value, corrected."""
    return words.p_equals(float(row["p_holm"]))


def effect_of(found: Findings, experiment: Experiment, mode: str, level: Level) -> str:
    """What a limit does to a mode: waiting and messages."""
    parts = []
    for measure, unit in ((WAITING, " s"), (MESSAGES, " per s")):
        row = row_of(found, experiment, LIMIT, measure, level, mode, mode)
        more, less, neither = CLAUSES[measure]
        clause = {1: more, -1: less, 0: neither}[direction(row)]
        parts.append(f"{clause} ({size(row, unit)}, {tested(row)})")
    return f"{mode}, {level.words}: {'; '.join(parts)}."


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
    hardest = row_of(found, experiment, BETWEEN, WAITING, experiment.hardest, HYBRID, DECENTRALISED)
    detail = f"{experiment.hardest.words} its waiting is {size(hardest, ' s')} that of decentralised, {tested(hardest)}"
    if stops is None:
        return f"Hybrid 3 pays to the end: {detail}."
    if loses is not None:
        return f"Hybrid 3 waits longer than decentralised from here on: {loses.words}; {detail}."
    return (
        f"Hybrid 3 is not shown to wait less than decentralised from here on: {stops.words}; {detail}. That is no "
        "proof that it waits as long."
    )


def harm_in_words(found: Findings, experiment: Experiment, measure: str) -> str:
    """Which mode the hardest level changes more than which other."""
    rows = [row_of(found, experiment, HARM, measure, experiment.hardest, a, b) for a, b in PAIRS]
    shown = [
        f"{row['a' if sign > 0 else 'b']} grows more than {row['b' if sign > 0 else 'a']} ({tested(row)})"
        for row in rows
        if (sign := direction(row))
    ]
    subject = "Waiting" if measure == WAITING else "Messages to the operator"
    if not shown:
        return f"{subject}: that the limit changes one mode more than another is not shown."
    return f"{subject}, as a ratio to no limit, {experiment.hardest.words}: {'; '.join(shown)}."


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
