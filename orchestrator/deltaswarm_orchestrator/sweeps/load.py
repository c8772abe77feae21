"""Load a built-in sweep or a TOML file, check it as a whole, and expand it into variants."""

import copy
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.scenarios import BUILT_IN, files_in
from deltaswarm_orchestrator.scenarios import load as scenarios
from deltaswarm_orchestrator.sweeps import forms
from deltaswarm_orchestrator.sweeps.forms import OWN, Row
from deltaswarm_orchestrator.sweeps.plan import LABEL, MAX_RUNS, Sweep, SweepFile, SweepSettings, Variant
from deltaswarm_orchestrator.sweeps.sensitivity import RangeSettings, SensitivitySettings, corners, drawn
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.foreign import called, name_of
from deltaswarm_wire.plugin_errors import PluginError, defined_at
from deltaswarm_wire.plugins import SWEEPS, find

STUDY_TABLES = (
    *("study", "metric", "contrast", "claim", "recovery", "fit", "grid"),
    *("survival", "rings", "figure", "finding"),
)
"""Tables of a study file that a sweep ignores."""

GRID = "events.density.file"

ALSO = "so it cannot also be given"


def files() -> dict[str, Traversable]:
    return files_in("sweeps/built_in")


@cache
def built_in() -> dict[str, dict[str, Traversable]]:
    """Return every built-in file that holds a sweep, by kind and name: sweeps, and what extensions add, as studies."""
    return {kind: _files_of(find(SWEEPS, kind, SWEEPS.group)) for kind in SWEEPS.names()}


def _files_of(function: Any) -> dict[str, Traversable]:
    found = called(name_of(function), function)
    if not isinstance(found, dict) or not all(isinstance(file, Traversable) for file in found.values()):
        must = f"{name_of(function)} must return a dict of files by name (got {found!r:.80})"
        raise PluginError(f"{must} ({defined_at(function)})")
    return found


def built_in_files() -> dict[str, Traversable]:
    return {name: file for files in built_in().values() for name, file in files.items()}


def load_sweep(
    name: str, overrides: Sequence[str] = (), settings: Mapping[str, int | float | None] | None = None
) -> Sweep:
    """Load a sweep from a file or by its built-in name.

    `overrides` set scenario keys of all variants, `settings` set keys of `[sweep]`.

    Raises:
        SettingsError: all mistakes in the file and the overrides together.
    """
    table, beside = read_file(name)
    table = {name: value for name, value in table.items() if name not in STUDY_TABLES}
    swept = table.setdefault("sweep", {})
    given = {setting: value for setting, value in (settings or {}).items() if value is not None}
    if isinstance(swept, dict):
        swept |= given | ({"repeats_of": {}} if "repeats" in given else {})
    return make_sweep(table, beside, overrides)


def make_sweep(table: dict[str, Any], beside: Path = Path(), overrides: Sequence[str] = ()) -> Sweep:
    """Make the sweep that a table describes; file names in the table are relative to the folder `beside`."""
    file, problems = _file(table)
    try:
        base = scenarios.read_table(file.base, beside, "base")
    except SettingsError as error:
        raise SettingsError([*problems, *error.problems]) from None
    shared = _flat(file.scenario, "scenario", beside, problems)
    for dotted, value in shared.items():
        problems += scenarios.put(base, dotted, value)
    for override in overrides:
        problems += scenarios.apply(base, override)
    has_variants = file.sweep.axes or file.sweep.paired or file.sweep.variants
    ranges = file.sensitivity.range if file.sensitivity else ()
    if file.sensitivity:
        file, wrong = _with_points(file, table.get("sweep"))
        problems += wrong
    choices, wrong = _choices(file.sweep, beside, ranges) if has_variants or not problems else ([], [])
    problems += wrong
    rows = [_joined(row) for row in itertools.product(*choices)] if choices else []
    set_here = [(f"scenario.{name}", name) for name in shared]
    set_here += [("--set", override.partition("=")[0].strip()) for override in overrides]
    in_all = set.intersection(*(set(row) for row in rows)) if rows else set()
    in_all |= {one.name for one in ranges}
    for reason, names in (("is set by the sweep for each run", OWN), ("varies in this sweep", in_all)):
        given = [(path, name) for path, name in set_here if name in names]
        problems += [Problem(name, repr(_at(base, name)), f"{reason}, {ALSO} {_place(path)}") for path, name in given]
    if ("--set", GRID) in set_here and not problems:  # a path on the command line is relative to the working folder
        scenarios.put(base, GRID, with_absolute_grids({GRID: _at(base, GRID)}, Path())[GRID])
    base["record"] = "off"
    points: list[list[Variant]] = []
    if file.sensitivity and not problems:
        points, wrong = _points(base, rows, file.sensitivity, beside)
        points = points[: file.sweep.repeats]
        variants = points[0] if points else []
    else:
        variants, wrong = _variants(base, rows)
    problems += wrong if rows else scenarios.check_table(base)[1]
    problems += [*forms.of_repeated_labels(rows), *forms.of_repeats(file, [row[LABEL] for row in rows])]
    problems += [
        Problem("sweep.series_every_s", f"{every_s:.15g}", f"must be a whole number of steps of {step_s:.15g} s")
        for every_s in [file.sweep.series_every_s]
        for step_s in dict.fromkeys(variant.scenario.run.step_s for row in points or [variants] for variant in row)
        if not math.isclose(every_s / step_s, round(every_s / step_s), rel_tol=1e-9)
    ]
    if problems:
        raise SettingsError(list(dict.fromkeys(problems)))
    # The sweep's record must show all that its runs had in common, including overrides from the command line.
    shared |= {name: _at(base, name) for path, name in set_here if path == "--set"}
    kept = file.base if file.base in BUILT_IN else str((beside / file.base).resolve())
    factors = [[_label(row) for row in rows] for rows in choices]
    return Sweep(replace(file, base=kept, scenario=shared), variants, factors, points, beside)


def _place(path: str) -> str:
    return f"by {path}" if path.startswith("--") else "in [scenario]"


def read_file(name: str, key: str = "sweep", also: Iterable[str] = ()) -> tuple[dict[str, Any], Path]:
    """Read a sweep or study from a file or by its built-in name; return its table and the folder of its paths.

    `key` and `also` are for the message about a name that does not exist, as for `read_toml`.
    """
    table, path = scenarios.read_toml(key, name, built_in_files(), also=also)
    table.pop("session", None)  # for participants; does not change a run
    return (table, Path()) if path is None else ({"name": path.stem, **table}, path.parent)


def _file(table: dict[str, Any]) -> tuple[SweepFile, list[Problem]]:
    """Check the form of a sweep file; return the file and its problems. Wrong keys count as not given."""
    known = {spec.name for spec in fields(SweepFile)}
    unknown = [checked.unknown_key(name, [*known, *STUDY_TABLES]) for name in table if name not in known]
    file, problems = checked.check(SweepFile, {name: value for name, value in table.items() if name in known})
    problems = [*unknown, *problems]
    if file is None:
        wrong = {problem.path for problem in problems}
        rest = {name: value for name, value in table.items() if name in known and name not in wrong}
        if isinstance(rest.get("sweep"), dict):
            rest["sweep"] = {name: value for name, value in rest["sweep"].items() if f"sweep.{name}" not in wrong}
        file, _ = checked.check(SweepFile, rest)
    if file is None:
        raise SettingsError(problems)
    return file, problems


def _flat(table: Mapping[str, Any], path: str, beside: Path, problems: list[Problem]) -> Row:
    """Flatten to dotted keys: TOML reads `control.delta = 3` as nested tables, `"control.delta" = 3` as one key.

    Paths of grids become absolute.
    """
    flat: Row = {}
    waiting = [*reversed(list(table.items()))]
    while waiting:
        name, value = waiting.pop()
        if isinstance(value, dict):
            waiting += [(f"{name}.{inner}", entry) for inner, entry in reversed(list(value.items()))]
            if not value:
                problems.append(Problem(f"{path}.{name}", "an empty table", "give it keys"))
        elif name in flat:
            problems.append(Problem(f"{path}.{name}", "given twice", "give it once"))
        else:
            flat[name] = value
    found: Row = with_absolute_grids(flat, beside)
    return found


def with_absolute_grids(value: Any, beside: Path, path: str = "") -> Any:
    """Make the paths of grids absolute, wherever in a table: they are relative to the file that names them."""
    if isinstance(value, dict):
        if value.get("name") == GRID and isinstance(choices := value.get("choices"), dict):  # a range of grids
            value = value | {"choices": {label: str(beside.absolute() / file) for label, file in choices.items()}}
        return {name: with_absolute_grids(inner, beside, f"{path}.{name}") for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [with_absolute_grids(inner, beside, path) for inner in value]
    is_grid = path.endswith(f".{GRID}") and isinstance(value, str) and value
    return str(beside.absolute() / value) if is_grid else value


def _choices(
    settings: SweepSettings, beside: Path, ranges: Sequence[RangeSettings] = ()
) -> tuple[list[list[Row]], list[Problem]]:
    """Return the rows of each axis, each paired table and the single variants, and all mistakes in their form."""
    problems: list[Problem] = []
    axes = _flat(settings.axes, "sweep.axes", beside, problems)
    paired = [_flat(table, f"sweep.paired[{i}]", beside, problems) for i, table in enumerate(settings.paired)]
    single = [_flat(table, f"sweep.variants[{i}]", beside, problems) for i, table in enumerate(settings.variants)]
    columns = [("sweep.axes", {name: values}) for name, values in axes.items()]
    columns += [(f"sweep.paired[{index}]", table) for index, table in enumerate(paired)]
    for path, keys in columns:
        problems += forms.of_lists(path, keys)
    problems += [*forms.of_labels(axes, paired, single), *forms.of_places(columns, single, ranges)]
    if problems:
        return [], problems
    lengths = [len(next(iter(table.values()))) for _, table in columns] + [len(single) or 1]
    if math.prod(lengths) * settings.repeats > MAX_RUNS:  # before the rows are expanded
        runs = f"{math.prod(lengths)} variants x {settings.repeats} repeats"
        return [], [Problem("sweep", runs, f"must be at most {MAX_RUNS} runs")]
    choices = [
        [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)] for _, table in columns
    ]
    if single:
        choices.append(single)
    return choices, []


def _joined(rows: Sequence[Row]) -> Row:
    """Merge one row of each table into a single row, and join the labels."""
    keys = {name: value for row in rows for name, value in row.items()}
    return {**keys, LABEL: ", ".join(map(_label, rows))}


def _label(row: Row) -> str:
    """Return a row's label; by default, the last part of each key with its value."""
    if LABEL in row:
        return str(row[LABEL])
    return ", ".join(f"{name.rpartition('.')[2]}={forms.shown(value)}" for name, value in row.items()) or "base"


def _variants(base: dict[str, Any], rows: Sequence[Row]) -> tuple[list[Variant], list[Problem]]:
    """Make a checked scenario for each row; report unknown keys and invalid values."""
    swept = {name: None for row in rows for name in row if name != LABEL}
    variants = []
    problems: dict[Problem, None] = {}  # each once, in order
    for row in rows:
        try:
            table = copy.deepcopy(base)
        except RecursionError:  # no valid scenario is nested so deeply
            return [], scenarios.check_table(base)[1]
        for name in row:
            problems |= dict.fromkeys(scenarios.put(table, name, row[name]) if name != LABEL else ())
        scenario, wrong = scenarios.check_table(table)
        problems |= dict.fromkeys(wrong)
        if scenario is not None:
            effective = checked.plain(scenario)
            variants.append(Variant(row[LABEL], {name: _at(effective, name) for name in swept}, scenario))
    return ([], list(problems)) if problems else (variants, [])


def _with_points(file: SweepFile, given: Any) -> tuple[SweepFile, list[Problem]]:
    """Return a sensitivity sweep's file with a replicate per point, unless its table `[sweep]` is `given` fewer."""
    assert file.sensitivity is not None
    points = file.sensitivity.points
    if not (isinstance(given, Mapping) and "repeats" in given):
        return replace(file, sweep=replace(file.sweep, repeats=points)), []
    if (repeats := file.sweep.repeats) <= points:
        return file, []
    allowed = f"must be at most sensitivity.points, {points}"
    return file, [Problem("sweep.repeats", str(repeats), allowed)]


def _points(
    base: dict[str, Any], rows: Sequence[Row], settings: SensitivitySettings, beside: Path
) -> tuple[list[list[Variant]], list[Problem]]:
    """Make the variants at each point; report ends that a key cannot have, or else the first point that is not legal.

    Besides the points, every pair of ranges is checked at its corners.
    """

    def at(point: Row) -> tuple[list[Variant], list[Problem]]:
        values = {one.name: one.value(point[one.name]) for one in settings.range}
        values = with_absolute_grids(values, beside)
        made, wrong = _variants(base, [{**row, **values} for row in rows])
        return [replace(variant, keys={**variant.keys, **point}) for variant in made], wrong

    points = drawn(settings)
    ends = [(i, one, at({**points[0], one.name: end})[1]) for i, one in enumerate(settings.range) for end in one.ends]
    problems = [
        Problem(f"sensitivity.range[{i}] ({one.name})", problem.given, problem.allowed)
        for i, one, wrong in ends
        for problem in wrong
        if _is_at(problem.path, one.name)
    ]
    everywhere = set.intersection(*(set(wrong) for _, _, wrong in ends))
    drawn_keys = [one.name for one in settings.range]
    problems += [
        problem
        for problem in ends[0][2]
        if problem in everywhere and not any(_is_at(problem.path, name) for name in drawn_keys)
    ]
    if problems:
        return [], problems
    made = []
    named = [("at a corner", corner) for corner in corners(settings, points[0])]
    for place, point in [*named, *((f"at point {number}", point) for number, point in enumerate(points))]:
        variants, wrong = at(point)
        if wrong:
            values = ", ".join(f"{name} = {forms.shown(value)}" for name, value in point.items())
            where = f"{place} of [sensitivity] ({values})"
            return [], [Problem(f"{problem.path}, {where},", problem.given, problem.allowed) for problem in wrong]
        made.append(variants)
    return made[len(named) :], []


def _is_at(path: str, name: str) -> bool:
    return path == name or path.startswith((f"{name}.", f"{name}["))


def _at(table: dict[str, Any], dotted: str) -> Any:
    """Return the value of a dotted key; None for a key that this scenario's controller does not have."""
    value: Any = table
    for name in scenarios.keys_in(dotted):
        value = value.get(name) if isinstance(value, dict) else None
    return value
