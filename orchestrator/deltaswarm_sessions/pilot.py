"""The number of participants for a study, from the table of a pilot's runs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import CommandError, aligned
from deltaswarm_sessions.folder import is_finite
from deltaswarm_sessions.plan import group_of
from deltaswarm_sessions.power import (
    ADJUSTED,
    MAX_PARTICIPANTS,
    RESAMPLES,
    ROUNDING,
    TESTS,
    Array,
    Pilot,
    fit,
    powers,
)
from deltaswarm_sessions.settings import CROSSED, SessionSettings
from deltaswarm_sessions.variables import KEYS, RESTRICTED, RUN, RUN_ITSELF, TEXT
from deltaswarm_wire.cells import raw
from deltaswarm_wire.reading import read_text, rows_of

MIN_DEGREES = 3
"""Degrees of freedom of a pilot's differences: with fewer, they say nothing about how much people differ."""

Row = dict[str, str]


class Question(NamedTuple):
    """What is to be shown: by default every metric, between the two conditions, with the pilot's own effect."""

    metric: str | None = None
    conditions: Sequence[str] | None = None
    effect: float | None = None
    power: float = 0.8
    alpha: float = 0.05
    test: str = next(iter(TESTS))


def plan_participants(settings: SessionSettings, runs: Path, question: Question) -> dict[str, Any]:
    """Return how many participants each metric needs, by the table of the pilot's runs."""
    first, second = pair = _conditions(settings, question)
    rows, columns = _read(runs, question.metric)
    if not columns:
        raise CommandError(f"{runs} must have complete and valid runs after the training with a measure (got none)")
    if question.metric is not None and question.metric not in columns:
        raise CommandError(f"--metric must be one of {', '.join(columns)} (got {question.metric!r})")
    group = group_of(len(settings.condition), is_crossed=settings.arrivals == CROSSED)
    metrics: dict[str, Any] = {}
    for metric in [question.metric] if question.metric else columns:
        found = _pilot(rows, pair, metric, is_adjusted=question.test == ADJUSTED)
        if isinstance(found, Pilot):
            metrics[metric] = _planned(found, question, group, settings.seed)
        elif question.metric:
            raise CommandError(f"{runs} {found}")
        else:
            metrics[metric] = {"problem": found}
    if all("problem" in row for row in metrics.values()):
        raise CommandError(
            f"{runs} {next((row['problem'] for row in metrics.values()), 'must have runs with numbers')}"
        )
    return {
        "contrast": f"{second} - {first}",
        "test": TESTS[question.test],
        "alpha": question.alpha,
        "power": question.power,
        "multiple_of": group,
        "metrics": metrics,
    }


def text(planned: dict[str, Any]) -> str:
    """Format the result of `plan_participants`: one metric with its powers, or several with a line each."""
    known = {name: row for name, row in planned["metrics"].items() if "problem" not in row}
    unknown = [f"{name}: {row['problem']}" for name, row in planned["metrics"].items() if name not in known]
    head = [
        f"{planned['contrast']}, by the {planned['test']} at alpha {planned['alpha']:g}, with a power of "
        f"{planned['power']:g} and {RESAMPLES} resamples; participants in multiples of {planned['multiple_of']}"
    ]
    rows = [("metric", "pilot", "difference", "95 % interval", "deviation", "effect", "participants")]
    rows += [(name, *_cells(row)) for name, row in known.items()]
    body = [aligned(rows)] if known else []
    if len(planned["metrics"]) == 1:
        for row in known.values():
            table = [(f"{one['participants']}", f"{one['power']:.3f}", f"{one['error']:.3f}") for one in row["powers"]]
            body += ["", aligned([("participants", "power", "standard error"), *table])]
    return "\n".join([*head, "", *body, *([""] if unknown else []), *unknown])


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    interval = f"{row['low']:.3g} to {row['high']:.3g}"
    needed = f"more than {MAX_PARTICIPANTS}" if row["participants"] is None else str(row["participants"])
    numbers = (f"{row[name]:.3g}" for name in ("deviation", "effect"))
    return (str(row["pilot"]), f"{row['difference']:.3g}", interval, *numbers, needed)


def _conditions(settings: SessionSettings, question: Question) -> tuple[str, str]:
    labels = [condition.label for condition in settings.condition]
    pair = labels if question.conditions is None else list(question.conditions)
    if len(set(pair)) == 2 and set(pair) <= set(labels):
        return pair[0], pair[1]
    got = ", ".join(pair) if question.conditions else f"none, and the session has {len(labels)}"
    raise CommandError(f"--conditions must be two of {', '.join(labels)} (got {got})")


def _read(runs: Path, metric: str | None = None) -> tuple[list[Row], list[str]]:
    """Return the valid runs after the training, and the columns with numbers that measure them."""
    seal.checked(runs.with_name(seal.RECORD))
    try:
        columns, lines = rows_of(read_text(runs), "\t")
        if missing := {*KEYS, "complete"} - {*columns}:
            raise ValueError(f"it lacks {', '.join(sorted(missing))}")
        for line, row in lines:
            for name in ("participant", "position"):
                if not row[name].isdecimal():
                    raise ValueError(f"line {line}, column {name}: must be a whole number (got {row[name]!r:.40})")
            for name in columns:
                is_number = name == metric or (name in RUN and RUN[name].kind != TEXT)
                if is_number and row[name] and not is_finite(row[name]):
                    raise ValueError(f"line {line}, column {name}: must be a finite number (got {row[name]!r:.40})")
        found = [{name: raw(cell) for name, cell in row.items()} for _, row in lines]
        rows = [row for row in found if _is_valid(row) and int(row["position"]) > 0]
    except (OSError, ValueError) as error:
        raise CommandError(
            f"{runs} must be the table of runs that `deltaswarm session --table` writes: {error}"
        ) from None
    own = [name for name in columns if name not in KEYS and name not in RUN_ITSELF]
    return rows, [name for name in own if _is_measured(rows, name)]


def _is_valid(row: Row) -> bool:
    return float(row["complete"] or 0) == 1 and float(row.get("valid") or 1) != 0


def _is_measured(rows: Sequence[Row], metric: str) -> bool:
    values = [row[metric] for row in rows if row[metric]]
    return bool(values) and all(map(is_finite, values))


def _pilot(rows: Sequence[Row], pair: tuple[str, str], metric: str, *, is_adjusted: bool) -> Pilot | str:
    """Return the participants' differences, second minus first, or what is wrong with the table of runs."""
    first, second = ({row["participant"]: row for row in rows if row["condition"] == name} for name in pair)
    both = [who for who in first if first[who][metric] and who in second and second[who][metric]]
    for name, of in zip(pair, (first, second), strict=True):
        reached = sum(_is_at_ceiling(of[who], metric) for who in both)
        if 2 * reached > len(both) > 0:
            return (
                f"must have {metric} below its ceiling, horizon_s, in most runs; a longer metrics.horizon_s shows more "
                f"(got {reached} of {len(both)} runs at it in {name})"
            )
    differences = np.array([float(second[who][metric]) - float(first[who][metric]) for who in both])
    others = _others([(first[who], second[who]) for who in both]) if is_adjusted else None
    streams = {row.get("stream", "") for row in rows} - {""}
    effects = 0 if others is None else max(1, len(streams), int(np.linalg.matrix_rank(others)))
    needed = MIN_DEGREES + 1 + effects
    if len(both) < needed:
        lacking = sorted({row["participant"] for row in rows} - {*both}, key=int)
        without = f"; without: {', '.join(lacking)}" if lacking else ""
        having = f", which {'are' if len(both) > 1 else 'is'} {', '.join(both)}" if both else ""
        adjusted = ", to adjust for position and stream" if is_adjusted else ""
        return (
            f"must have {metric} in {' and in '.join(pair)} of at least {needed} participants{adjusted} "
            f"(got {len(both)}{having}{without})"
        )
    pilot = fit(differences, others)
    if pilot is None:
        return "must have the conditions in several orders, to adjust for position and stream; --test t does not"
    if pilot.deviation <= ROUNDING * max(1.0, float(np.max(np.abs(differences)))):
        return f"must have participants whose difference in {metric} varies (got {pilot.mean:g} of each)"
    return pilot


def _is_at_ceiling(run: Row, metric: str) -> bool:
    horizon_s = float(run.get("horizon_s") or "inf")  # tables of earlier versions lack it
    return metric in RESTRICTED and float(run[metric]) >= horizon_s


def _others(pairs: Sequence[tuple[Row, Row]]) -> Array:
    """Return, for each pair of runs, how they differ in position and in the stream of arrivals: a column for each."""
    streams = sorted({run.get("stream", "") for pair in pairs for run in pair} - {""})
    rows = [
        [
            float(second["position"]) - float(first["position"]),
            *(float(second["stream"] == stream) - float(first["stream"] == stream) for stream in streams),
        ]
        for first, second in pairs
    ]
    return np.array(rows, dtype=float).reshape(len(pairs), 1 + len(streams))


def _planned(pilot: Pilot, question: Question, group: int, seed: int) -> dict[str, Any]:
    effect = pilot.mean if question.effect is None else question.effect
    tried = powers(
        pilot,
        effect,
        group=group,
        wanted=question.power,
        alpha=question.alpha,
        test=question.test,
        seed=seed,
    )
    low, high = pilot.interval
    return {
        "pilot": len(pilot.residuals),
        "difference": pilot.mean,
        "low": low,
        "high": high,
        "deviation": pilot.deviation,
        "effect": effect,
        "powers": [row._asdict() for row in tried],
        "participants": next((row.participants for row in tried if row.power >= question.power), None),
    }
