"""Convert scenario keys from Python (values, classes, functions) into what the command line's `--set` takes."""

import io
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from deltaswarm.errors import Error
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import shown
from deltaswarm_wire.files import write_whole
from deltaswarm_wire.foreign import called
from deltaswarm_wire.plugin_errors import defined_at, note_plugin

DENSITY = "events.density"

MAIN = "__main__"
"""The module of what a notebook or script defines; another process cannot import it."""

MAX_INTEGER = 2**63 - 1
"""The largest integer of TOML."""

MOST_CELLS = 1000
"""Maximum number of cells along one side of the arena, of a density that is given as a function."""


def overrides(keys: Mapping[Any, Any], path: str = "") -> list[str]:
    """Return `key=value` for each key; tables within tables are merged into those of the scenario.

    A class, as a value or as the name of a table, stands for its `module:Class`.

    Raises:
        Error: a value is none that a scenario can hold, or a class cannot be found by its name.
    """
    try:
        return [f"{key}={value}" for key, value in _flat(keys, path)]
    except RecursionError:
        raise Error(f"{path or 'keys'} must not hold itself, nor be nested so deeply") from None


def _flat(keys: Mapping[Any, Any], path: str) -> Iterator[tuple[str, str]]:
    for name, value in keys.items():
        key = f'"{name_of(name, path)}"' if isinstance(name, type) else str(name)
        dotted = f"{path}.{key}" if path else key
        if isinstance(value, Mapping) and (value or ":" not in key):  # else a plug-in without options
            yield from _flat(value, dotted)
        else:
            yield dotted, _toml(value, dotted)


def _toml(value: Any, path: str) -> str:
    value = value.tolist() if type(value).__module__ == "numpy" and hasattr(value, "tolist") else value
    match value:
        case bool():
            return str(value).lower()
        case int() | float() if not isinstance(value, int) or abs(value) <= MAX_INTEGER:
            return repr(value)
        case str() | os.PathLike():
            return json.dumps(os.fspath(value), ensure_ascii=False)
        case type():
            return json.dumps(name_of(value, path))
        case Mapping():
            inner = (f"{json.dumps(str(name))} = {_toml(one, f'{path}.{name}')}" for name, one in value.items())
            return f"{{{', '.join(inner)}}}"
        case list() | tuple():
            return f"[{', '.join(_toml(one, path) for one in value)}]"
    raise Error(f"{path} must be a number, a text, a list, a table or a class (got {shown(value)})")


def name_of(cls: type, path: str) -> str:
    """Return `module:Class` of a class.

    Raises:
        Error: its module has no such class, as for one that is defined in a function.
    """
    module, name = cls.__module__, cls.__qualname__
    if getattr(sys.modules.get(module), name, None) is not cls:
        raise Error(f"{path} must be a class at the top level of a module or a notebook (got {module}.{name})")
    return f"{module}:{name}"


def check_importable(given: list[str], why: str) -> None:
    """Check that no value is a class of a notebook or script, which other processes cannot import.

    Raises:
        Error: one is; `why` says what needs other processes, and what does not.
    """
    for key, _, value in (override.partition("=") for override in given):
        if f"{MAIN}:" in key or f'"{MAIN}:' in value:
            raise Error(f"{key} must name a class that other processes can import, in a file of its own: {why}")


def scenario_of(
    name: str, keys: Mapping[Any, Any], seed: int | None, commands: Path | None, grid: Path
) -> tuple[Scenario, list[str]]:
    """Load a scenario with keys; return it with the keys as overrides.

    A function `events.density` of x and y [m] is written to the file `grid`, as cells of at most 1 m; of an arena above
    1000 m, as 1000 cells along a side.

    Raises:
        Error, SettingsError: the scenario has mistakes.
    """
    density = keys.get(DENSITY)
    if not callable(density):
        given = overrides(keys)
        return load_scenario(name, given, seed, commands), given
    given = overrides({key: value for key, value in keys.items() if key != DENSITY})
    arena = load_scenario(name, given, seed, commands).arena
    _write_grid(density, arena.width_m, arena.height_m, grid)
    given += overrides({DENSITY: {"kind": "grid", "file": grid.absolute(), "path_m": [], "path_s": []}})
    return load_scenario(name, given, seed, commands), given


def _write_grid(density: Callable[[float, float], float], width_m: float, height_m: float, file: Path) -> None:
    import numpy as np

    columns, rows = (min(math.ceil(length_m), MOST_CELLS) for length_m in (width_m, height_m))
    xs_m, ys_m = ((np.arange(cells) + 0.5) * size_m / cells for cells, size_m in ((columns, width_m), (rows, height_m)))
    note_plugin(str(getattr(density, "__module__", "")))
    places_m = [(x_m, y_m) for y_m in ys_m.tolist() for x_m in xs_m.tolist()]
    values = called(f"the function {DENSITY}", lambda: [density(*place_m) for place_m in places_m], at=density)
    weights = np.full((rows, columns), np.nan)
    for cell, (value, (x_m, y_m)) in enumerate(zip(values, places_m, strict=True)):
        with suppress(TypeError, ValueError):
            weights.flat[cell] = float(value)
        if not 0 <= weights.flat[cell] < math.inf:
            given = f"got {value!r:.80} at x = {x_m:g} m, y = {y_m:g} m"
            raise Error(f"{DENSITY} must return finite numbers from 0 on ({given}) ({defined_at(density)})")
    if not 0 < weights.sum() < math.inf:
        raise Error(f"{DENSITY} must have a positive, finite sum (got {weights.sum():g}) ({defined_at(density)})")
    file.parent.mkdir(parents=True, exist_ok=True)
    np.save(data := io.BytesIO(), weights)
    write_whole(file, data.getvalue())
