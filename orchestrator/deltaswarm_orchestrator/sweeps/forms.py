"""Check what a sweep file varies: lists, labels, keys given twice, replicates."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import orjson

from deltaswarm_orchestrator.sweeps.plan import LABEL, MAX_RUNS, SweepFile
from deltaswarm_orchestrator.sweeps.sensitivity import RangeSettings
from deltaswarm_wire.checked import Problem

OWN = ("seed", "record")
"""Scenario keys that a sweep sets for each run."""

SAME = ("schema", "name")
"""Scenario keys that do not change a run."""

Row = dict[str, Any]
"""Dotted keys with their values, and possibly a label."""


def of_lists(path: str, table: Row) -> Iterator[Problem]:
    """Report values that are not lists, empty lists, and lists of different lengths."""
    lists = {name: values for name, values in table.items() if isinstance(values, list) and values}
    for name in table:
        if name not in lists:
            yield Problem(f"{path}.{name}", shown(table[name]), "must be a list of at least one value")
    if not table:
        yield Problem(path, "no keys", "give it lists of values")
    if len({len(values) for values in lists.values()}) > 1:
        lengths = ", ".join(f"{name}: {len(values)}" for name, values in lists.items())
        yield Problem(path, f"lists of different lengths ({lengths})", "must be of one length")


def of_labels(axes: Row, paired: Sequence[Row], single: Sequence[Row]) -> Iterator[Problem]:
    """Report labels that are not one-line strings, that label nothing, or that are not allowed in that place."""
    if LABEL in axes:
        yield Problem(f"sweep.axes.{LABEL}", "no scenario key", "put it into [[sweep.paired]]")
    given = [(f"sweep.variants[{index}].{LABEL}", row[LABEL]) for index, row in enumerate(single) if LABEL in row]
    for index, table in enumerate(paired):
        if list(table) == [LABEL]:
            yield Problem(f"sweep.paired[{index}]", "only a label", "give it a key with a list too")
        if isinstance(labels := table.get(LABEL), list):
            given += [(f"sweep.paired[{index}].{LABEL}", label) for label in labels]
    for path, label in given:
        if not (isinstance(label, str) and label.strip() and label.isprintable()):
            yield Problem(path, shown(label), "must be a string of one line")


def of_places(
    columns: Sequence[tuple[str, Row]], single: Sequence[Row], ranges: Sequence[RangeSettings]
) -> Iterator[Problem]:
    """Report keys given in two places, keys that cannot vary, and a sweep in which nothing varies."""
    places = [(path, name) for path, table in columns for name in table if name != LABEL]
    places += [("sweep.variants", name) for name in {name: None for row in single for name in row if name != LABEL}]
    has_variants = bool(places or (single and ranges))
    places += [(f"sensitivity.range[{i}]", one.name) for i, one in enumerate(ranges)]
    times = Counter(name for _, name in places)
    for path, name in places:
        if times[name] > 1:
            yield Problem(f"{path}.{name}", "also given elsewhere", "let it vary in only one place")
        ends = [index for index, letter in enumerate(name[:500]) if letter == "."]  # no key is longer
        if part_of := next((name[:end] for end in ends if name[:end] in times), None):
            yield Problem(f"{path}.{name}", f"{part_of} varies too", "let it vary in only one place")
        if name in OWN + SAME:
            reason = "the sweep sets it for each run" if name in OWN else "it has no effect on a run"
            yield Problem(f"{path}.{name}", "cannot vary", reason)
    if not has_variants:
        allowed = "must have [sweep.axes], [[sweep.paired]] or [[sweep.variants]]"
        yield Problem("sweep", "nothing varies", allowed)


def of_repeats(file: SweepFile, labels: Sequence[str]) -> Iterator[Problem]:
    """Report replicates of single variants that there are not, that are too few, or that no point can have."""
    least = file.sweep.repeats
    for label, repeats in file.sweep.repeats_of.items():
        path = f"sweep.repeats_of.{label}"
        if file.sensitivity:
            yield Problem(path, str(repeats), "must not be set: a sensitivity sweep runs every variant at every point")
        elif labels and label not in labels:
            yield Problem(path, "no variant of this label", f"must be one of {', '.join(map(repr, labels))}")
        elif isinstance(repeats, bool) or not isinstance(repeats, int) or not least <= repeats <= MAX_RUNS:
            allowed = f"must be a whole number from {least}, the sweep's repeats, to {MAX_RUNS}"
            yield Problem(path, shown(repeats), allowed)
    numbers = [repeats for repeats in file.sweep.repeats_of.values() if isinstance(repeats, int)]
    if (runs := least * (len(labels) - len(numbers)) + sum(numbers)) > MAX_RUNS:
        yield Problem("sweep.repeats_of", f"{runs} runs", f"must be at most {MAX_RUNS} runs")


def of_repeated_labels(rows: Sequence[Row]) -> Iterator[Problem]:
    """Report labels of more than one variant."""
    for label, times in Counter(row[LABEL] for row in rows).items():
        if times > 1:
            yield Problem("sweep", f"{times} variants called {label!r}", "must have different labels")


def shown(value: Any) -> str:
    """Format a value for people, in at most 200 characters."""
    if not isinstance(value, str):
        try:
            value = orjson.dumps(value).decode()
        except TypeError:  # an integer or nesting beyond orjson's limits
            try:
                value = repr(value)
            except (ValueError, RecursionError):
                value = type(value).__name__
    return value if len(value) <= 200 else f"{value[:197]}..."
