"""Load a built-in scenario or a TOML file, apply `--set`, and check the result as a whole."""

import dataclasses
import re
import tomllib
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import tomli_w

from deltaswarm_orchestrator.scenarios import BUILT_IN, LANGUAGES
from deltaswarm_scenario.density import SAMPLES, is_free, share_problems, spread
from deltaswarm_scenario.operator_settings import (
    NO_ORDERS,
    OPERATOR,
    PRICE,
    SET_DELTA,
    SET_PRICE,
    SET_STRUCTURE,
    SWARM,
    begun_with,
)
from deltaswarm_scenario.page_language import LanguageSettings
from deltaswarm_scenario.radio import RadioSettings
from deltaswarm_scenario.scenario import Scenario, WorldSettings
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError, did_you_mean
from deltaswarm_wire.commands import forms_of, named
from deltaswarm_wire.controller_metrics import declared
from deltaswarm_wire.plugins import (
    DYNAMICS,
    RADIO_MODELS,
    controller_settings,
    find,
    find_controller,
    is_recorded,
    own_settings,
)
from deltaswarm_wire.reading import parsed_toml
from deltaswarm_wire.reading import read_toml as read_toml_file
from deltaswarm_wire.settings import AgentSettings, ControlSettings

LANGUAGE = "operator.page.language"


def load_scenario(
    name: str, overrides: Sequence[str] = (), seed: int | None = None, commands: Path | None = None
) -> Scenario:
    """Load a scenario from a file or by its built-in name, with `key=value` overrides.

    `commands` is a file of `[[command]]` tables.

    Raises:
        SettingsError: it lists every mistake in file and overrides.
    """
    table = read_table(name)
    problems = [problem for override in overrides for problem in apply(table, override)]
    _resolve_grid(table, Path())  # of an override: the run's own scenario is read elsewhere
    if seed is not None:
        table["seed"] = seed
    if commands is not None:
        problems += _read_commands(table, commands)
    scenario, more = check_table(table)
    if scenario is None or problems + more:
        raise SettingsError(problems + more)
    return scenario


def check_table(table: dict[str, Any]) -> tuple[Scenario | None, list[Problem]]:
    """Return the scenario that a table describes, and all mistakes in the table."""
    wrong_language = _read_language(table)
    scenario, problems = checked.check(Scenario, table)
    problems = [*wrong_language, *problems]
    if scenario is not None:
        world, wrong_options = _with_world_options(scenario)
        scenario = dataclasses.replace(scenario, world=world)
        problems += wrong_options
    options, wrong_options = _control_options(table, scenario)
    problems += wrong_options
    if scenario is not None:
        scenario = dataclasses.replace(
            scenario,
            control=ControlSettings(scenario.control.mode, options),
            radio=_with_model_options(scenario.radio),
            fault=tuple(dataclasses.replace(fault, options=checked.plain(fault.own())) for fault in scenario.fault),
        )
        problems += _grid_problems(scenario)
        if not wrong_options:
            problems += _command_problems(scenario)
    return scenario, problems


def _read_commands(table: dict[str, Any], file: Path) -> list[Problem]:
    try:
        table["command"] = read_toml_file(file)["command"]
    except (OSError, ValueError, KeyError) as error:
        reason = _instead_of_file(file) or ("it has none" if isinstance(error, KeyError) else str(error))
        return [Problem("--commands", f"{str(file)!r}; {reason}", "must be a TOML file with [[command]] tables")]
    return []


def _command_problems(scenario: Scenario) -> list[Problem]:
    """Return a problem for each command of script, simulation or page that the controller does not accept."""
    operator = scenario.operator
    if not scenario.has_commander and not operator.page.orders and operator.autonomy.sets_delta == OPERATOR:
        return []
    controller = find_controller(scenario.control.mode)
    if is_recorded(controller):
        return []
    forms = begun_with(forms_of(controller), scenario.control.options)
    names = ", ".join(form.name for form in forms if scenario.control.mode not in form.refused_in) or "none"
    problems = []
    by_budget = SET_PRICE if operator.budget.moves == PRICE else SET_STRUCTURE
    needed = by_budget if operator.autonomy.keeps_budget else SET_DELTA
    form = named(forms, needed)
    if form is None or scenario.control.mode in form.refused_in:
        wrong = f"needs a controller that accepts {needed!r} ({scenario.control.mode} accepts: {names})"
        if operator.person.commands and form is None:
            problems.append(Problem("operator.person.policy", repr(operator.person.policy), wrong))
        if operator.autonomy.commands:
            problems.append(Problem("operator.autonomy.sets_delta", repr(operator.autonomy.sets_delta), wrong))
    if operator.autonomy.sets_delta == SWARM and scenario.control.options.get("delta_rule", "fixed") == "fixed":
        wrong = "needs agents that choose delta themselves: control.mode = 'adaptive', or control.delta_rule = 'busy'"
        problems.append(Problem("operator.autonomy.sets_delta", repr(SWARM), wrong))
    if operator.person.commands and operator.autonomy.sets_delta != OPERATOR:
        wrong = "must be operator with a simulated person that sets delta, or that person's policy none"
        problems.append(Problem("operator.autonomy.sets_delta", repr(operator.autonomy.sets_delta), wrong))
    orders = () if operator.page.orders == NO_ORDERS else operator.page.orders
    if unknown := [order for order in orders if named(forms, order) is None]:
        wrong = f"must be orders that {scenario.control.mode} accepts: {names}"
        problems.append(Problem("operator.page.orders", ", ".join(unknown), wrong))
    for number, command in enumerate(scenario.command):
        form = named(forms, command.name)
        wrong = f"must be a command that {scenario.control.mode} accepts: {names}"
        if form is not None:
            wrong = form.problem(command.command(number).target, command.arguments) or ""
        if wrong:
            problems.append(Problem(f"command[{number}].name", repr(command.name), wrong))
    return problems


def _control_options(table: dict[str, Any], scenario: Scenario | None) -> tuple[dict[str, Any], list[Problem]]:
    """Return all options of the table's controller, defaults included, and all mistakes in them.

    `scenario` is the rest of the table, if that is valid.
    """
    control, _ = checked.check(ControlSettings, table.get("control", {}))
    radio, _ = checked.check(RadioSettings, table.get("radio", {}))
    if control is None:
        return {}, []  # reported with the other keys
    shared = scenario.for_agent(0) if scenario else AgentSettings(range_m=(radio or RadioSettings()).range_m)
    try:
        declared(control.mode)
        return checked.plain(controller_settings(control.mode, control.options, shared)), []
    except SettingsError as error:
        return {}, error.problems


def _with_world_options(scenario: Scenario) -> tuple[WorldSettings, list[Problem]]:
    """Return the world's settings with all options of its dynamics, defaults included, and all mistakes in them."""
    world = scenario.world
    try:
        own = own_settings(DYNAMICS, world.dynamics, world.options, "world", "dynamics", scenario)
        return WorldSettings(world.dynamics, checked.plain(own)), []
    except SettingsError as error:
        return WorldSettings(), error.problems


def _with_model_options(radio: RadioSettings) -> RadioSettings:
    """Return the radio's settings with all options of its models from outside, defaults included."""
    models = {name: own_settings(RADIO_MODELS, name, options, "radio") for name, options in radio.models.items()}
    return dataclasses.replace(radio, models={name: checked.plain(own) for name, own in models.items()})


def to_toml(settings: Scenario | AgentSettings) -> str:
    """Return the effective settings as TOML, with every key."""
    return tomli_w.dumps(checked.plain(settings))


def commented_toml(scenario: Scenario) -> str:
    """Return the effective scenario as TOML, with each key's meaning as a comment."""
    options = find_controller(scenario.control.mode).Settings()
    bodies = find(DYNAMICS, scenario.world.dynamics, "world.dynamics").Settings()
    own = [key for fault in scenario.fault for key in keys_of(fault.own(), "fault.")]
    keys = [
        *own,
        *keys_of(options, "control."),
        *keys_of(bodies, "world."),
        *keys_of(Scenario(), ""),
    ]  # the scenario's last, so that they win
    about = {key.replace("[]", ""): spec.metadata["doc"] for key, spec, _, _ in keys}
    lines, table = [], ""
    for line in to_toml(scenario).splitlines():
        if line.startswith("["):
            table = line.strip("[]") + "."
        name, sign, _ = line.partition(" = ")
        meaning = about.get(f"{table}{name}") if sign else None
        lines.append(f"{line:<40}  # {meaning}" if meaning else line)
    return "\n".join(lines) + "\n"


def read_table(name: str, beside: Path = Path(), key: str = "scenario") -> dict[str, Any]:
    """Read the unchecked table of a built-in scenario or of a file; a relative path starts at `beside`."""
    table, path = read_toml(key, name, BUILT_IN, beside)
    if path is not None:
        _resolve_grid(table, path.parent)
        if isinstance(language := _page(table).get("language"), str):
            _page(table)["language"] = language_at(language, path.parent)
    return table


def read_toml(
    key: str, name: str, built_in: Mapping[str, Traversable], beside: Path = Path(), also: Iterable[str] = ()
) -> tuple[dict[str, Any], Path | None]:
    """Read the table of a built-in file (path None) or of another file, and return it with the file's path.

    `also` are other names that the user could have meant.
    """
    if name in built_in:
        return parsed_toml(built_in[name].read_text(encoding="utf-8")), None
    path = beside / name
    if obstacle := _instead_of_file(path):
        names = list(dict.fromkeys([*also, *built_in]))
        allowed = f"must be a TOML file{' or one of ' if names else ''}{', '.join(names)}"
        raise SettingsError([Problem(key, f"{name!r}; {did_you_mean(name, names)}{obstacle}", allowed)])
    try:
        table = read_toml_file(path)
    except (ValueError, OSError) as error:  # also integers of thousands of digits
        raise SettingsError([Problem(str(path), str(error), "must be TOML")]) from None
    if "schema" not in table:
        raise SettingsError([Problem("schema", "missing", "add schema = 1")])
    return table, path


def _instead_of_file(path: Path) -> str:
    """Say what is at a path that must be a file; empty if it is a file."""
    try:
        if path.is_file():
            return ""
        is_folder = path.is_dir()
    except (OSError, ValueError):  # a name that is too long, or a folder that may not be read
        is_folder = False
    return f"{path.absolute()} is a folder" if is_folder else f"there is no file {path.absolute()}"


def _resolve_grid(table: dict[str, Any], folder: Path) -> None:
    """Make a grid's path absolute; it is relative to the scenario that names it."""
    events = table.get("events", {})
    density = events.get("density", {}) if isinstance(events, dict) else {}
    if isinstance(density, dict) and isinstance(density.get("file"), str) and density["file"]:
        density["file"] = str((folder / density["file"]).resolve())


def language_at(name: str, folder: Path) -> str:
    """Return a language's name if it is built in, else its file's path; a relative one starts at `folder`."""
    return name if name in ("", *LANGUAGES) else str((folder / name).resolve())


def _page(table: dict[str, Any]) -> dict[str, Any]:
    """Return the table [operator.page] of a scenario; an empty one if there is none."""
    operator = table.get("operator")
    page = operator.get("page") if isinstance(operator, dict) else None
    return page if isinstance(page, dict) else {}


def _read_language(table: dict[str, Any]) -> list[Problem]:
    """Replace the name of a language's file by what is in the file, so that a run's scenario has all of it."""
    page = _page(table)
    if not isinstance(name := page.get("language"), str):
        return []
    page["language"] = {}
    if not name:
        return []
    try:
        found, _ = read_toml(LANGUAGE, name, LANGUAGES)
    except SettingsError as error:
        return error.problems
    page["language"] = {key: value for key, value in found.items() if key != "schema"}
    texts = found.get("page")
    unknown = LanguageSettings.unknown(texts) if isinstance(texts, dict) else []
    return [Problem(f"{LANGUAGE}.{problem.path}", problem.given, problem.allowed) for problem in unknown]


def _grid_problems(scenario: Scenario) -> list[Problem]:
    """Check, before anything is started, that a grid can be read and lets events occur."""
    density = scenario.events.density
    if density.kind != "grid":
        return []
    import numpy as np  # slow to import, and few scenarios need it

    from deltaswarm_scenario.grid import read_grid

    try:
        grid = read_grid(density.file)
    except OSError as error:
        return [Problem("events.density.file", repr(density.file), f"must be readable ({error.strerror})")]
    except ValueError as error:
        allowed = "must be a table of finite weights >= 0 with a positive sum"
        return [Problem("events.density.file", f"{density.file!r}: {error}", allowed)]
    if not (obstacles := scenario.arena.obstacles):
        return []
    rows, columns = grid.shape
    shares = np.cumsum(grid.ravel() / grid.sum())
    cells = np.searchsorted(shares[:-1], (np.arange(SAMPLES) + 0.5) / SAMPLES, side="right")
    corners = np.stack([cells % columns, cells // columns], axis=1)
    within = np.array(list(spread((0.0, 0.0), (1.0, 1.0))))
    places_m = (corners + within) * [scenario.arena.width_m / columns, scenario.arena.height_m / rows]
    return share_problems(sum(is_free(place, obstacles) for place in places_m.tolist()) / SAMPLES)


def apply(table: dict[str, Any], override: str) -> list[Problem]:
    """Set one dotted key from `key=value`; the value is TOML, or else a plain string."""
    path, sign, text = override.partition("=")
    if not sign or not all(keys_in(path.strip())):
        return [Problem("--set", repr(override), "must be key=value")]
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        value = text
    return put(table, path.strip(), value)


def put(table: dict[str, Any], path: str, value: Any) -> list[Problem]:
    keys = keys_in(path)
    if not all(keys):
        return [Problem(path or "''", "no key", "must be a dotted key such as control.delta")]
    for key in keys[:-1]:
        table = table.setdefault(key, {})
        if not isinstance(table, dict):
            return [Problem(path, f"{key!r} is not a table", "must be a key of a table")]
    table[keys[-1]] = value
    return []


def keys_in(path: str) -> list[str]:
    """Split a dotted key; a quoted part may hold dots, as in TOML."""
    return [part.strip('"') for part in re.split(r'\.(?=(?:[^"]*"[^"]*")*[^"]*$)', path)]


def keys_of(settings: Any, prefix: str) -> Iterator[tuple[str, "dataclasses.Field[Any]", Any, Any]]:
    """Yield each dotted key of some settings with field, type and value; a list's key comes before its items' keys."""
    hints = typing.get_type_hints(type(settings))
    for spec in dataclasses.fields(settings):
        value = getattr(settings, spec.name)
        items = [item for item in typing.get_args(hints[spec.name]) if dataclasses.is_dataclass(item)]
        if value is None and items:
            value = typing.cast(Any, items[0])()
        if dataclasses.is_dataclass(value):
            yield from keys_of(value, f"{prefix}{spec.name}.")
            continue
        yield f"{prefix}{spec.name}", spec, hints[spec.name], value
        for item in items:
            yield from keys_of(typing.cast(Any, item)(), f"{prefix}{spec.name}[].")
