"""Make the pages of all keys from the settings: docs/SCENARIO.md, and of sweeps and studies docs/STUDY_KEYS.md."""

import dataclasses
import json
import re
import sys
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from deltaswarm_orchestrator.scenarios.load import keys_of
from deltaswarm_orchestrator.sweeps.plan import SweepFile
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.settings import StudyFile
from deltaswarm_studies.study import UNITS
from deltaswarm_wire import checked
from deltaswarm_wire.plugins import CONTROLLERS, DYNAMICS, FAULTS, INBOX_POLICIES, ExtensionPoint, find, find_controller

REFERENCE_HEAD = """\
# Scenario keys

A scenario is a TOML file with `schema = 1`. Every key can also be set by `--set key=value`. `name[].key` is a key of
each table `[[name]]`. A key without a default is absent unless you set it. Limits of a list apply to its items.
Where no limit is stated, a number is from -1,000,000,000 to 1,000,000,000; above 0 means at least 0.000000001. The
source says whether a default is the paper's or our reading of what the paper leaves open ([readings](READINGS.md)).
"""

REFERENCE_TABLE = (
    "| key | type | default | unit | limits | meaning | source |",
    "| --- | --- | --- | --- | --- | --- | --- |",
)

STUDY_HEAD = """\
# Keys of sweep and study files

A sweep or a study is a TOML file with `schema = 1`. [Sweeps](SWEEPS.md) use the top level and `[sweep]`;
[studies](STUDIES.md) add the other tables. `name[].key` is a key of each table `[[name]]`. A key without a default is
absent unless you set it. Limits of a list apply to its items.
"""

STUDY_TABLE = tuple(line.removesuffix(end) for line, end in zip(REFERENCE_TABLE, (" source |", " --- |"), strict=True))

TYPES = {int: "integer", float: "number", str: "string", bool: "boolean"}


def reference() -> str:
    """Return docs/SCENARIO.md: every scenario key, by section, with type, default, unit, limits and meaning."""
    scenario = Scenario()
    rows = _reference_rows(scenario, "")
    lines = [REFERENCE_HEAD, "## Top level", "", *REFERENCE_TABLE, *_top(scenario, rows)]
    for name, section in _sections(scenario, rows, REFERENCE_TABLE):
        lines += section
        if name == "control":
            lines += _controller_tables("control.")
        if name == "world":
            lines += _own_tables(DYNAMICS, "world.")
        if name == "fault":
            lines += _own_tables(FAULTS, "fault[].")
        if name == "operator":
            lines += _own_tables(INBOX_POLICIES, "operator.inbox.")
    return "\n".join(lines) + "\n"


def study_reference() -> str:
    """Return docs/STUDY_KEYS.md: every key of a sweep file and of the tables that a study adds."""
    lines = [STUDY_HEAD, "## Top level", "", *STUDY_TABLE]
    sections: list[str] = []
    for settings in (SweepFile(), StudyFile()):
        rows = {key: row.removesuffix(" |") for key, row in _reference_rows(settings, "").items()}  # no source
        lines += _top(settings, rows)
        sections += [line for _, section in _sections(settings, rows, STUDY_TABLE) for line in section]
    return "\n".join([*lines, *sections]) + "\n"


def _top(settings: Any, rows: Mapping[str, str]) -> list[str]:
    """Return the rows of the keys outside any section."""
    names = [spec.name for spec in _with_section(settings, rows)]
    return [row for key, row in rows.items() if not any(_is_below(key, name, itself=True) for name in names)]


def _sections(settings: Any, rows: Mapping[str, str], head: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield each section's name and its lines: a heading and a table of its keys."""
    for spec in _with_section(settings, rows):
        heading = f"[[{spec.name}]]" if spec.name in rows else f"[{spec.name}]"
        below = [row for key, row in rows.items() if _is_below(key, spec.name)]
        yield spec.name, ["", f"## `{heading}`: {spec.metadata['doc']}", "", *head, *below]


def _with_section(settings: Any, rows: Mapping[str, str]) -> "list[dataclasses.Field[Any]]":
    return [spec for spec in dataclasses.fields(settings) if any(_is_below(key, spec.name) for key in rows)]


def _is_below(key: str, section: str, itself: bool = False) -> bool:
    return key.startswith((f"{section}.", f"{section}[].")) or (itself and key == section)


def _controller_tables(prefix: str) -> Iterator[str]:
    """Yield a table of each shipped controller's options; of one that shares options with hybrid, what differs."""
    known = set(_reference_rows(find_controller("hybrid").Settings(), prefix).values())
    for target in dict.fromkeys(CONTROLLERS.shipped.values()):
        modes = [mode for mode, other in CONTROLLERS.shipped.items() if other == target]
        rows = _reference_rows(find_controller(modes[0]).Settings(), prefix).values()
        differing = [row for row in rows if row not in known]
        is_like_hybrid = "hybrid" not in modes and len(differing) < len(rows)
        yield from ("", f"### {', '.join(f'`{mode}`' for mode in modes)}", "")
        if is_like_hybrid:
            yield from ("The options of `hybrid`, with other defaults for these:", "")
        yield from (*REFERENCE_TABLE, *(rows if "hybrid" in modes else differing))


def _own_tables(point: ExtensionPoint, prefix: str) -> Iterator[str]:
    """Yield a table of the keys of each kind that has any, of those that come with deltaswarm or its extensions."""
    for kind in point.names():
        if rows := _reference_rows(find(point, kind, prefix).Settings(), prefix):
            yield from ("", f"### `{kind}`", "", *REFERENCE_TABLE, *rows.values())


def _reference_rows(settings: Any, prefix: str) -> dict[str, str]:
    """Return the table row of every key, by key."""
    rows = {}
    for key, spec, hint, value in keys_of(settings, prefix):
        if spec.metadata.get("rest"):
            continue
        unit, meaning = _unit(spec)
        default = "" if value is None else f"`{json.dumps(checked.plain_value(value))}`"
        cells = (f"`{key}`", _type(hint), default, unit, _limits(spec.metadata), meaning, spec.metadata["source"])
        rows[key] = "".join(f"| {cell} " if cell else "| " for cell in cells) + "|"
    return rows


def _unit(spec: "dataclasses.Field[Any]") -> tuple[str, str]:
    """Return a key's unit, from its name or its text, and the text without it."""
    text = spec.metadata["doc"]
    unit = next((unit for end, unit in UNITS.items() if f"_{spec.name}".endswith(end)), "")
    said = re.findall(r" \[([^\]]+)\]", text)
    if len(said) == 1 and unit in ("", *said):
        [unit] = said
        text = text.replace(f" [{unit}]", "")
    return unit.replace("m2", "m²"), text


def _type(hint: Any, plural: str = "") -> str:
    """Name a type in the words of TOML."""
    arms = typing.get_args(hint)
    origin = typing.get_origin(hint)
    if origin is tuple:
        return f"list{plural} of {_type(arms[0], 's')}"
    if origin is types.UnionType:
        return _type(arms[0], plural)
    return TYPES.get(hint, "table") + plural


def _limits(metadata: Mapping[str, Any]) -> str:
    """Show what the values of a key may be."""
    if metadata["choices"]:
        return ", ".join(f"`{choice}`" for choice in metadata["choices"])
    low, high, above, length = (metadata[name] for name in ("low", "high", "above", "length"))
    shown = [f"{length} items"] if length is not None else []
    if low is not None and low == high:
        shown.append(f"{low}")
    elif low is not None and high is not None:
        shown.append(f"{low:,.15g} to {high:,.15g}" if high < 1e15 else f"{low:,.15g} to {high}")
    else:
        signs = (("≥", low), (">", above), ("≤", high))
        shown += [f"{sign} {limit:,.15g}" for sign, limit in signs if limit is not None]
    return ", ".join(shown)


if __name__ == "__main__":
    print(study_reference() if sys.argv[1:] == ["study"] else reference(), end="")
