"""Finds the body that a board's file names."""

import importlib
from dataclasses import is_dataclass
from typing import Any

from deltaswarm_agent.body import ENTRY_POINTS, Body, BodyContext
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError

SHIPPED = {
    "kinematic": "deltaswarm_agent.bodies.kinematic:KinematicBody",
    "mavlink": "deltaswarm_agent.bodies.mavlink:MavlinkBody",
}
"""By name, without the search through all installed packages that an entry point takes."""

_NEEDED = ("Settings", "REAL_TIME", "sense", "move", "close")


def find_body(kind: str, path: str = "body.kind") -> type[Body]:
    """The class that `kind` names: one of ours, an entry point, or `module:Class`.

    Raises:
        SettingsError: nothing of that name, it cannot be imported, or it is no body.
    """
    target = kind if ":" in kind else SHIPPED.get(kind) or _entry_point(kind, path)
    module, _, name = target.partition(":")
    try:
        found: Any = getattr(importlib.import_module(module), name)
    except Exception as error:  # whatever a plug-in's module may raise
        told = f"cannot be imported: {type(error).__name__}: {error}"
        raise SettingsError([Problem(path, repr(kind), told)]) from None
    missing = [needed for needed in _NEEDED if not hasattr(found, needed)]
    if missing:
        raise SettingsError([Problem(path, repr(kind), f"is no body: it lacks {', '.join(missing)}")])
    if not is_dataclass(found.Settings):
        raise SettingsError([Problem(path, repr(kind), "is no body: its Settings are no dataclass")])
    body: type[Body] = found
    return body


def _entry_point(kind: str, path: str) -> str:
    from importlib import metadata  # 7 MB, which an agent with a shipped body does without

    installed = {point.name: point.value for point in metadata.entry_points(group=ENTRY_POINTS)}
    if kind not in installed:
        known = ", ".join(sorted({"world", *SHIPPED, *installed}))
        raise SettingsError([Problem(path, repr(kind), f"one of {known}, or module:Class, is allowed")])
    return installed[kind]


def options_of(body: type[Body], table: dict[str, Any], path: str = "body.options") -> Any:
    """The body's own options, checked.

    Raises:
        SettingsError: with every mistake in them.
    """
    return checked.load(body.Settings, table, path)


def make_body(body: type[Body], options: Any, context: BodyContext) -> Body:
    """A body of this class."""
    make: Any = body
    made: Body = make(options, context)
    return made
