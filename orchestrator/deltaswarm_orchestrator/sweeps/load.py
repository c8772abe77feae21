"""Sweep files: TOML or built in, checked as a whole, spread out into variants."""

import copy
import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import orjson

from deltaswarm_orchestrator.run import scenario as scenarios
from deltaswarm_orchestrator.sweeps.plan import LABEL, MAX_RUNS, Sweep, SweepFile, SweepSettings, Variant
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.settings import Scenario

STUDY_FOLDERS = ("studies/paper", "studies/limits", "studies/operator")

BUILT_IN = scenarios.files_in("sweeps/built_in", *STUDY_FOLDERS)
"""The file of each built-in sweep; those of studies hold a sweep too."""

STUDY_TABLES = ("study", "metric", "contrast", "claim", "recovery", "figure", "finding")
"""What a study file has beside its sweep: for a sweep it means nothing."""

OWN = ("seed", "record")
"""Scenario keys that a sweep sets for each run."""

SAME = ("schema", "name")
"""Scenario keys that make no other run."""

GRID = "events.density.file"

Row = dict[str, Any]
"""Dotted keys with their values, and perhaps a label."""


def load_sweep(
    name: str, overrides: Sequence[str] = (), settings: Mapping[str, int | float | None] | None = None
) -> Sweep:
    """The sweep of a file or a built-in name; `overrides` are scenario keys for all, `settings` keys of `[sweep]`.

    Raises:
        SettingsError: every mistake in file and overrides at once.
    """
    table, beside = read_file(name)
    table = {name: value for name, value in table.items() if name not in STUDY_TABLES}
    own = table.setdefault("sweep", {})
    if isinstance(own, dict):
        own |= {setting: value for setting, value in (settings or {}).items() if value is not None}
    return make_sweep(table, beside, overrides)


def make_sweep(table: dict[str, Any], beside: Path = Path(), overrides: Sequence[str] = ()) -> Sweep:
    """The sweep that a table describes; the files that it names are looked for `beside`.

    Raises:
        SettingsError: every mistake at once.
    """
    file, problems = _file(table)
    try:
        base = scenarios.read_table(file.base, beside, "base")
    except SettingsError as error:
        raise SettingsError([*problems, *error.problems]) from None
    shared = _flat(file.scenario, "scenario", problems)
    _make_absolute(shared, beside)
    for dotted, value in shared.items():
        problems += scenarios.put(base, dotted, value)
    for override in overrides:
        problems += scenarios.apply(base, override)
    has_variants = file.sweep.axes or file.sweep.paired or file.sweep.variants
    choices, found = _choices(file.sweep, beside) if has_variants or not problems else ([], [])
    problems += found
    rows = [_joined(row) for row in itertools.product(*choices)] if choices else []
    set_here = [(f"scenario.{name}", name) for name in shared]
    set_here += [("--set", override.partition("=")[0].strip()) for override in overrides]
    problems += [
        Problem(path, name, "must not be set: the sweep sets it for each run") for path, name in set_here if name in OWN
    ]
    in_all = set.intersection(*(set(row) for row in rows)) if rows else set()
    problems += [
        Problem(path, name, "must not be set: it varies in this sweep") for path, name in set_here if name in in_all
    ]
    if ("--set", GRID) in set_here and not problems:  # on the command line, relative to where it was given
        scenarios.put(base, GRID, _absolute(_at(base, GRID), Path()))
    variants, found = _variants({**base, "record": "off"}, rows)
    problems += found if rows else scenarios.check_table(base)[1]
    if problems:
        raise SettingsError(list(dict.fromkeys(problems)))
    # So the sweep's own record says all that its runs had in common, whatever the command line was.
    shared |= {name: _at(base, name) for path, name in set_here if path == "--set"}
    kept = file.base if file.base in scenarios.BUILT_IN else str((beside / file.base).resolve())
    factors = [[_label(row) for row in rows] for rows in choices]
    return Sweep(replace(file, base=kept, scenario=shared), variants, factors)


def read_file(name: str) -> tuple[dict[str, Any], Path]:
    """The table of a sweep's or study's file or built-in name, and the folder that its paths start from.

    Raises:
        SettingsError: there is no such file, or it is no TOML.
    """
    table, path = scenarios.read_toml("sweep", name, BUILT_IN)
    table.pop("session", None)  # for participants: it makes no other run
    return (table, Path()) if path is None else ({"name": path.stem, **table}, path.parent)


def _file(table: dict[str, Any]) -> tuple[SweepFile, list[Problem]]:
    """The sweep file, and what is wrong in its form; a key that is wrong counts as not given.

    Raises:
        SettingsError: it is so wrong that no more can be said of it.
    """
    file, problems = checked.check(SweepFile, table)
    if file is None:
        wrong = {problem.path for problem in problems}
        rest = {name: value for name, value in table.items() if name not in wrong}
        if isinstance(rest.get("sweep"), dict):
            rest["sweep"] = {name: value for name, value in rest["sweep"].items() if f"sweep.{name}" not in wrong}
        file, _ = checked.check(SweepFile, rest)
    if file is None:
        raise SettingsError(problems)
    return file, problems


def _flat(table: Mapping[str, Any], path: str, problems: list[Problem]) -> Row:
    """Dotted keys: TOML reads `control.delta = 3` as a table within a table, `"control.delta" = 3` as a key."""
    flat: Row = {}
    waiting = [*reversed(list(table.items()))]
    while waiting:
        name, value = waiting.pop()
        if isinstance(value, dict):
            waiting += [(f"{name}.{inner}", one) for inner, one in reversed(list(value.items()))]
            if not value:
                problems.append(Problem(f"{path}.{name}", "an empty table", "give it keys"))
        elif name in flat:
            problems.append(Problem(f"{path}.{name}", "given twice", "give it once"))
        else:
            flat[name] = value
    return flat


def _make_absolute(row: Row, beside: Path) -> None:
    """A grid's file, or those of a list, are relative to the file that names them."""
    named = row.get(GRID)
    if isinstance(named, list):
        row[GRID] = [_absolute(one, beside) for one in named]
    elif named is not None:
        row[GRID] = _absolute(named, beside)


def _absolute(named: Any, beside: Path) -> Any:
    return str(beside.absolute() / named) if isinstance(named, str) and named else named


def _choices(settings: SweepSettings, beside: Path) -> tuple[list[list[Row]], list[Problem]]:
    """The rows of each axis, of each paired table and of the single variants; all mistakes in their form."""
    problems: list[Problem] = []
    axes = _flat(settings.axes, "sweep.axes", problems)
    paired = [_flat(table, f"sweep.paired[{index}]", problems) for index, table in enumerate(settings.paired)]
    single = [_flat(table, f"sweep.variants[{index}]", problems) for index, table in enumerate(settings.variants)]
    for row in (axes, *paired, *single):
        _make_absolute(row, beside)
    columns = [("sweep.axes", {name: values}) for name, values in axes.items()]
    columns += [(f"sweep.paired[{index}]", table) for index, table in enumerate(paired)]
    problems += [problem for path, table in columns for problem in _problems_of_lists(path, table)]
    problems += _problems_of_labels(axes, paired, single) + _problems_of_places(columns, single)
    if problems:
        return [], problems
    lengths = [len(next(iter(table.values()))) for _, table in columns] + [len(single) or 1]
    if math.prod(lengths) * settings.repeats > MAX_RUNS:  # before they are spread out
        runs = f"{math.prod(lengths)} variants x {settings.repeats} repeats"
        return [], [Problem("sweep", runs, f"must be at most {MAX_RUNS} runs")]
    choices = [
        [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)] for _, table in columns
    ]
    if single:
        choices.append(single)
    return choices, []


def _problems_of_lists(path: str, table: Row) -> list[Problem]:
    """Lists that are none, are empty, or of different lengths."""
    lists = {name: values for name, values in table.items() if isinstance(values, list) and values}
    problems = [
        Problem(f"{path}.{name}", _shown(table[name]), "must be a list of at least one value")
        for name in table
        if name not in lists
    ]
    if not table:
        problems.append(Problem(path, "no keys", "give it lists of values"))
    if len({len(values) for values in lists.values()}) > 1:
        found = ", ".join(f"{name}: {len(values)}" for name, values in lists.items())
        problems.append(Problem(path, f"lists of different lengths ({found})", "must be of one length"))
    return problems


def _problems_of_labels(axes: Row, paired: Sequence[Row], single: Sequence[Row]) -> list[Problem]:
    """Labels that are no words, label nothing, or stand where none can."""
    problems = []
    if LABEL in axes:
        problems.append(Problem(f"sweep.axes.{LABEL}", "no scenario key", "put it into [[sweep.paired]]"))
    given = [(f"sweep.variants[{index}].{LABEL}", row[LABEL]) for index, row in enumerate(single) if LABEL in row]
    for index, table in enumerate(paired):
        if list(table) == [LABEL]:
            problems.append(Problem(f"sweep.paired[{index}]", "only a label", "give it a key with a list too"))
        if isinstance(labels := table.get(LABEL), list):
            given += [(f"sweep.paired[{index}].{LABEL}", label) for label in labels]
    allowed = "must be a string of one line"
    return problems + [
        Problem(path, _shown(label), allowed)
        for path, label in given
        if not (isinstance(label, str) and label.strip() and label.isprintable())
    ]


def _problems_of_places(columns: Sequence[tuple[str, Row]], single: Sequence[Row]) -> list[Problem]:
    """Keys that stand in two places, that cannot vary, or none at all."""
    places = [(path, name) for path, table in columns for name in table if name != LABEL]
    places += [("sweep.variants", name) for name in {name: None for row in single for name in row if name != LABEL}]
    times = Counter(name for _, name in places)
    problems: list[Problem] = []
    for path, name in places:
        if times[name] > 1:
            problems.append(Problem(f"{path}.{name}", "also given elsewhere", "let it vary in one place only"))
        ends = [index for index, letter in enumerate(name[:500]) if letter == "."]  # no key is longer
        if part_of := next((name[:end] for end in ends if name[:end] in times), None):
            problems.append(Problem(f"{path}.{name}", f"{part_of} varies too", "let it vary in one place only"))
        if name in OWN:
            problems.append(Problem(f"{path}.{name}", "cannot vary", "the sweep sets it for each run"))
        if name in SAME:
            problems.append(Problem(f"{path}.{name}", "cannot vary", "it changes no run"))
    if not places:
        allowed = "must have [sweep.axes], [[sweep.paired]] or [[sweep.variants]]"
        problems.append(Problem("sweep", "nothing varies", allowed))
    return problems


def _joined(rows: Iterable[Row]) -> Row:
    """One row from one row of each table; the labels joined."""
    joined: Row = {}
    labels = []
    for row in rows:
        labels.append(_label(row))
        joined |= row
    return {**joined, LABEL: ", ".join(labels)}


def _label(row: Row) -> str:
    """A row's label; for those who gave none, the keys' last parts with their values."""
    if LABEL in row:
        return str(row[LABEL])
    return ", ".join(f"{name.rpartition('.')[2]}={_shown(value)}" for name, value in row.items()) or "base"


def _shown(value: Any) -> str:
    """A value for people, of bounded length."""
    if not isinstance(value, str):
        try:
            value = orjson.dumps(value).decode()
        except TypeError:  # an integer or a depth beyond what JSON is good for
            try:
                value = repr(value)
            except (ValueError, RecursionError):
                value = type(value).__name__
    return value if len(value) <= 200 else f"{value[:197]}..."


def _variants(base: dict[str, Any], rows: Sequence[Row]) -> tuple[list[Variant], list[Problem]]:
    """A checked scenario for each row; and unknown keys, values not allowed, labels that two variants have."""
    swept = {name: None for row in rows for name in row if name != LABEL}
    made: list[tuple[str, Scenario]] = []
    problems: dict[Problem, None] = {}  # each once, in order
    for row in rows:
        try:
            table = copy.deepcopy(base)
        except RecursionError:  # no scenario is as deep as that
            return [], scenarios.check_table(base)[1]
        found = [problem for name in row if name != LABEL for problem in scenarios.put(table, name, row[name])]
        scenario, more = scenarios.check_table(table)
        problems |= dict.fromkeys(found + more)
        if scenario is not None:
            made.append((row[LABEL], scenario))
    for label, times in Counter(row[LABEL] for row in rows).items():
        if times > 1:
            problems[Problem("sweep", f"{times} variants called {label!r}", "must have different labels")] = None
    if problems:
        return [], list(problems)
    tables = [(label, scenario, checked.plain(scenario)) for label, scenario in made]
    return [
        Variant(label, {name: _at(table, name) for name in swept}, scenario) for label, scenario, table in tables
    ], []


def _at(table: dict[str, Any], dotted: str) -> Any:
    """What stands under a dotted key; None for a key that this scenario's controller does not have."""
    value: Any = table
    for name in dotted.split("."):
        value = value.get(name) if isinstance(value, dict) else None
    return value
