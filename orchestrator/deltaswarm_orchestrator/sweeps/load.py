"""Sweep files: TOML or built in, checked as a whole, spread out into variants."""

import copy
import itertools
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import orjson

from deltaswarm_orchestrator import scenario as scenarios
from deltaswarm_orchestrator.sweeps.plan import LABEL, MAX_RUNS, Sweep, SweepFile, SweepSettings, Variant
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.settings import Scenario

BUILT_IN = ("paper", "modes", "smoke")

Row = dict[str, Any]
"""Dotted keys with their values, and perhaps a label."""


def load_sweep(
    name: str, overrides: Sequence[str] = (), settings: Mapping[str, int | float | None] | None = None
) -> Sweep:
    """The sweep of a file or a built-in name; `overrides` are scenario keys for all, `settings` keys of `[sweep]`.

    Raises:
        SettingsError: every mistake in file and overrides at once.
    """
    table, beside = _read(name)
    own = table.setdefault("sweep", {})
    if isinstance(own, dict):
        own |= {setting: value for setting, value in (settings or {}).items() if value is not None}
    return make_sweep(table, beside, overrides)


def make_sweep(table: dict[str, Any], beside: Path = Path(), overrides: Sequence[str] = ()) -> Sweep:
    """The sweep that a table describes; a base scenario's file is looked for `beside`.

    Raises:
        SettingsError: every mistake at once.
    """
    file, problems = checked.check(SweepFile, table)
    if file is None:
        raise SettingsError(problems)
    base, problems = scenarios.read_table(file.base, beside)
    for dotted, value in _flat(file.scenario).items():
        problems += scenarios.put(base, dotted, value)
    for override in overrides:
        problems += scenarios.apply(base, override)
    _, found = scenarios.check_table(base)
    rows, found_in_rows = _rows(file.sweep)
    problems += found + found_in_rows
    if len(rows) * file.sweep.repeats > MAX_RUNS:
        runs = f"{len(rows)} variants x {file.sweep.repeats} repeats"
        problems.append(Problem("sweep", runs, f"at most {MAX_RUNS} runs are allowed"))
    if problems:
        raise SettingsError(problems)
    return Sweep(file, _variants({**base, "record": "off"}, rows))


def _read(name: str) -> tuple[dict[str, Any], Path]:
    """The sweep's table and the folder that its paths start from."""
    if name in BUILT_IN:
        text = resources.files("deltaswarm_orchestrator").joinpath(f"sweeps/built_in/{name}.toml").read_text()
        return tomllib.loads(text), Path()
    path = Path(name)
    if not path.is_file():
        allowed = f"a TOML file or one of {', '.join(BUILT_IN)} is allowed"
        raise SettingsError([Problem("sweep", f"{name!r} is not there", allowed)])
    try:
        table = tomllib.loads(path.read_text())
    except (ValueError, RecursionError, OSError) as error:
        raise SettingsError([Problem(str(path), str(error), "TOML is expected")]) from None
    if "schema" not in table:
        raise SettingsError([Problem("schema", "missing", "schema = 1 is expected")])
    return {"name": path.stem, **table}, path.parent


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted keys: TOML reads `control.delta = 3` as a table within a table."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return flat


def _rows(settings: SweepSettings) -> tuple[list[Row], list[Problem]]:
    """Every combination of the axes, the paired tables' rows and the single variants; all mistakes in their form."""
    columns = [("sweep.axes", {name: values}) for name, values in _flat(settings.axes).items()]
    columns += [(f"sweep.paired[{index}]", _flat(table)) for index, table in enumerate(settings.paired)]
    single = [_flat(table) for table in settings.variants]
    problems = _problems_of_form(columns, single)
    if problems:
        return [], problems
    choices = [
        [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)] for _, table in columns
    ]
    if single:
        choices.append(single)
    return [_joined(rows) for rows in itertools.product(*choices)], []


def _problems_of_form(columns: Sequence[tuple[str, Row]], single: Sequence[Row]) -> list[Problem]:
    """Lists that are none, of different lengths, or for one key in two places."""
    problems: list[Problem] = []
    places = [(path, name) for path, table in columns for name in table if name != LABEL]
    places += [("sweep.variants", name) for name in {name: None for row in single for name in row if name != LABEL}]
    for path, table in columns:
        lists = {name: values for name, values in table.items() if isinstance(values, list) and values}
        problems += [
            Problem(f"{path}.{name}", repr(table[name]), "a list of at least one value is expected")
            for name in table
            if name not in lists
        ]
        if len({len(values) for values in lists.values()}) > 1:
            lengths = ", ".join(f"{name}: {len(values)}" for name, values in lists.items())
            problems.append(
                Problem(path, f"lists of different lengths ({lengths})", "lists of one length are expected")
            )
    times = Counter(name for _, name in places)
    for path, name in places:
        if times[name] > 1:
            problems.append(Problem(f"{path}.{name}", "also given elsewhere", "a key may vary in one place only"))
        if name in ("seed", "record"):
            problems.append(Problem(f"{path}.{name}", "cannot vary", "the sweep itself sets it"))
    if not places:
        allowed = "[sweep.axes], [[sweep.paired]] or [[sweep.variants]] is expected"
        problems.append(Problem("sweep", "nothing varies", allowed))
    return problems


def _joined(rows: Iterable[Row]) -> Row:
    """One row from one row of each table; the labels joined."""
    joined: Row = {}
    labels = []
    for row in rows:
        keys = {name: value for name, value in row.items() if name != LABEL}
        labels.append(str(row[LABEL]) if LABEL in row else _described(keys))
        joined |= keys
    return {LABEL: ", ".join(labels), **joined}


def _described(row: Row) -> str:
    """A label for those who gave none: the keys' last parts with their values."""
    return ", ".join(f"{name.rpartition('.')[2]}={_shown(value)}" for name, value in row.items())


def _shown(value: Any) -> str:
    return value if isinstance(value, str) else orjson.dumps(value).decode()


def _variants(base: dict[str, Any], rows: Sequence[Row]) -> list[Variant]:
    """A checked scenario for each row.

    Raises:
        SettingsError: a key is unknown, a value is not allowed, or two variants have one label.
    """
    swept = {name: None for row in rows for name in row if name != LABEL}
    variants: list[Variant] = []
    problems: list[Problem] = []
    for row in rows:
        table = copy.deepcopy(base)
        found = [problem for name in row if name != LABEL for problem in scenarios.put(table, name, row[name])]
        scenario, more = scenarios.check_table(table)
        problems += [problem for problem in found + more if problem not in problems]
        if any(variant.label == row[LABEL] for variant in variants):
            problems.append(Problem("sweep", f"two variants called {row[LABEL]!r}", "different labels are expected"))
        if scenario is not None and not found:
            variants.append(Variant(row[LABEL], {name: _value_of(scenario, name) for name in swept}, scenario))
    if problems:
        raise SettingsError(problems)
    return variants


def _value_of(scenario: Scenario, dotted: str) -> Any:
    value: Any = scenario
    for name in dotted.split("."):
        value = getattr(value, name)
    return checked.plain_value(value)
