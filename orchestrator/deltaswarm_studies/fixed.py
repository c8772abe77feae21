"""What a protocol fixes of a study, and how two versions of it differ."""

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, get_args, get_origin, get_type_hints

from deltaswarm_orchestrator.base import frozen
from deltaswarm_orchestrator.base.frozen import ABSENT, Difference, Table, as_read
from deltaswarm_orchestrator.scenarios.load import check_table
from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.operator_settings import BUDGET
from deltaswarm_scenario.scenario import content_of
from deltaswarm_studies.origin import plugin_digests
from deltaswarm_studies.settings import StudyFile
from deltaswarm_studies.stats import ALPHA
from deltaswarm_studies.study import Study
from deltaswarm_wire import checked

FORMAT = 2
"""The format of entries that are written now. Those of format 1 hold seeds, of the study's file, and no code."""

SHOWN_ONLY = ("figure", "finding")
"""Tables of a study file that no protocol holds: findings are written after the runs, and figures decide nothing."""

WORDS_ONLY = ("title", "why", "words")
"""Keys that no protocol holds."""

RUN_ONLY = ("schema", "record")
"""Keys of a scenario that do not change what happens in a run."""

UNUSED_UNLESS = {"operator.budget.": ("operator.autonomy.sets_delta", BUDGET)}
"""Keys of a scenario that do nothing unless another has this value: another default of theirs changes no run."""

RENAMED = {"control.adapts_delta": ("control.delta_rule", {False: "fixed", True: "busy"})}
"""Keys of older protocols, with their names of today and what their values are called now."""


def content(study: Study, entry_format: int = FORMAT) -> Table:
    """Return all of a study that its protocol fixes: runs, outcomes, criteria, margins, expectations."""
    swept, drawn = study.sweep.file.sweep, study.sweep.file.sensitivity
    tables = {
        variant.label: {name: value for name, value in flattened(content_of(variant.scenario)) if name not in RUN_ONLY}
        for variant in study.sweep.variants
    }
    tables = {label: _not_drawn(table, [one.name for one in study.ranges]) for label, table in tables.items()}
    first = next(iter(tables.values()))
    shared = {
        name: value
        for name, value in first.items()
        if all(name in table and table[name] == value for table in tables.values())
    }
    own = {
        label: {name: value for name, value in table.items() if name not in shared} for label, table in tables.items()
    }
    runs: Table = {"repeats": swept.repeats}
    if entry_format < FORMAT:
        runs |= {"seed": swept.seed, "seeds": study.sweep.seeds, "extensions": plugin_digests(study)}
    runs |= {"series_every_s": swept.series_every_s, **({"repeats_of": swept.repeats_of} if swept.repeats_of else {})}
    asked = {
        name: _rows(value) if isinstance(value, tuple) else fixed_keys(value)
        for name, value in vars(study.file).items()
        if name not in SHOWN_ONLY
    }
    sensitivity = {"sensitivity": fixed_keys(drawn) | {"range": _rows(drawn.range)}} if drawn else {}
    if drawn and entry_format >= FORMAT:
        del sensitivity["sensitivity"]["seed"]
    if drawn and drawn.runs_per_point == 1:  # entries from before the key was there lack it
        del sensitivity["sensitivity"]["runs_per_point"]
    return as_read(
        {"scenario": shared, "condition": own, "runs": runs, **sensitivity, "tests": {"alpha": ALPHA}} | asked
    )


def fixed_keys(settings: Any) -> Table:
    return {name: value for name, value in checked.plain(settings).items() if name not in WORDS_ONLY}


def _rows(tables: Sequence[Any]) -> dict[str, Table]:
    """Return tables by their names, or by their places where they have none."""
    rows: dict[str, Table] = {}
    for place, settings in enumerate(tables, start=1):
        name = next((text for key in ("id", "name", "text") if (text := getattr(settings, key, ""))), "")
        rows[name if name and name not in rows else f"{name} {place}".strip()] = fixed_keys(settings)
    return rows


def differences(old: Table, new: Table) -> list[Difference]:
    """List what differs between two versions. A key that deltaswarm did not have yet counts as its default."""
    old, new = completed(old), completed(new)
    was, now = old.pop("condition"), new.pop("condition")
    found = {label: list(frozen.differences(was[label], now[label])) for label in was if label in now}
    in_all = [change for change in next(iter(found.values()), []) if all(change in each for each in found.values())]
    return [
        *(change._replace(key=f"scenario.{change.key}") for change in in_all),
        *(
            change._replace(key=f"condition.{label}.{change.key}")
            for label, changes in found.items()
            for change in changes
            if change not in in_all
        ),
        *(Difference(f"condition.{label}", "there", ABSENT) for label in was if label not in now),
        *(Difference(f"condition.{label}", ABSENT, "there") for label in now if label not in was),
        *frozen.differences(old, new),
    ]


def completed(protocol: Table) -> Table:
    """Return a protocol with all keys of each condition, and today's defaults of the keys that it lacks."""
    shared = protocol["scenario"]
    completed = {name: table for name, table in protocol.items() if name != "scenario"}
    drawn = protocol.get("sensitivity", {}).get("range", {})
    condition = {
        label: {**_defaults({**shared, **own}["control.mode"]), **_named_now({**shared, **own})}
        for label, own in protocol["condition"].items()
    }
    completed["condition"] = {label: _used(_not_drawn(table, drawn)) for label, table in condition.items()}
    for name, kind in get_type_hints(StudyFile).items():
        told = protocol.get(name, {})
        if get_origin(kind) is tuple:
            defaults = as_read(fixed_keys(get_args(kind)[0]()))
            completed[name] = {row: {**defaults, **table} for row, table in told.items()}
        else:
            completed[name] = {**as_read(fixed_keys(kind())), **told}
    return completed


def _not_drawn(table: Table, drawn: Iterable[str]) -> Table:
    """Return a scenario without the keys that a sensitivity study draws. A key may be a table, such as a density."""
    names = tuple(drawn)
    return {key: value for key, value in table.items() if not any(f"{key}.".startswith(f"{name}.") for name in names)}


def _named_now(table: Table) -> Table:
    """Return a table with the keys of today in place of older ones."""
    older = {name: table[name] for name in RENAMED if name in table}
    named = {RENAMED[name][0]: RENAMED[name][1][value] for name, value in older.items()}
    return {name: value for name, value in table.items() if name not in older} | named


def _used(table: Table) -> Table:
    unused = tuple(prefix for prefix, (key, value) in UNUSED_UNLESS.items() if table.get(key) != value)
    return {name: value for name, value in table.items() if not name.startswith(unused)}


@cache
def _defaults(mode: str) -> Table:
    """Return the keys of a scenario in which only the control mode is set; none if there is no such mode now."""
    scenario, _ = check_table({"schema": 1, "control": {"mode": mode}})
    table = dict(flattened(checked.plain(scenario))) if scenario else {}
    return {name: value for name, value in table.items() if name not in RUN_ONLY}
