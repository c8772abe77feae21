"""Plug-ins: classes found by name, and their options checked by their own `Settings`.

A name is that of a shipped class, of an entry point, or `module:Class`.
"""

import importlib
from collections.abc import Collection, Mapping
from dataclasses import is_dataclass
from typing import Any

from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError

PAPER = "deltaswarm_agent.controllers.paper.controller:PaperController"

CONTROLLERS = {
    "decentralised": PAPER,
    "hierarchical": PAPER,
    "hybrid": PAPER,
    "adaptive": "deltaswarm_agent.controllers.paper.adaptive:AdaptiveController",
    "central": "deltaswarm_agent.controllers.central.controller:CentralController",
    "potential": "deltaswarm_agent.controllers.potential:PotentialController",
}
"""The shipped controllers, by the short names that `control.mode` takes. A new one is a line here."""

BODIES = {
    "kinematic": "deltaswarm_agent.bodies.kinematic:KinematicBody",
    "mavlink": "deltaswarm_agent.bodies.mavlink:MavlinkBody",
    "ros2": "deltaswarm_agent.bodies.ros2.body:Ros2Body",
}
"""The shipped bodies, by the short names that `body.kind` takes on a board. A new one is a line here."""

MAX_DESCRIBED = 400
"""Characters of a foreign error's text."""

CONTROLLER_GROUP = "deltaswarm.controllers"
"""The group of entry points in which an installed package names its controllers."""

BODY_GROUP = "deltaswarm.bodies"
"""The same for bodies."""


def find_class(
    name: str,
    *,
    what: str,
    path: str,
    shipped: Mapping[str, str],
    group: str,
    needed: Collection[str],
    others: Collection[str] = (),
) -> type[Any]:
    """Find the class that `name` refers to.

    Args:
        name: a key of `shipped`, an entry point of `group`, or `module:Class`.
        what: the role of the class, for messages, such as "controller".
        path: the settings key that holds the name, for messages.
        shipped: `module:Class` by short name, found without a search through all installed packages.
        group: the group of entry points.
        needed: the attributes that the class must have; `Settings` must be a dataclass.
        others: names with a meaning elsewhere, for messages.

    Raises:
        SettingsError: there is no such class, it cannot be imported, or it lacks something.
    """
    target = name if ":" in name else shipped.get(name) or _entry_point(name, what, path, shipped, group, others)
    module, _, attribute = target.partition(":")
    try:
        attribute_value: Any = getattr(importlib.import_module(module), attribute)
    except (Exception, SystemExit) as error:  # a plug-in may raise anything; a script ends by SystemExit
        must = f"must name a class that can be imported: {described(error)}"
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            must += "; PYTHONPATH must name the folder of the module"
        raise SettingsError([Problem(path, repr(name), must)]) from None
    missing = [attribute for attribute in needed if not hasattr(attribute_value, attribute)]
    if missing:
        raise SettingsError([Problem(path, repr(name), f"must be a {what} with {', '.join(missing)}")])
    if not (isinstance(attribute_value.Settings, type) and is_dataclass(attribute_value.Settings)):
        raise SettingsError([Problem(path, repr(name), f"must be a {what} whose Settings is a dataclass")])
    cls: type[Any] = attribute_value
    return cls


def _entry_point(
    name: str, what: str, path: str, shipped: Mapping[str, str], group: str, others: Collection[str]
) -> str:
    from importlib.metadata import entry_points  # costs a board 2 MB; most need no entry point

    installed = {point.name: point.value for point in entry_points(group=group)}
    if name not in installed:
        known = sorted({*shipped, *installed, *others})
        hint = checked.did_you_mean(name, known).rstrip()
        allowed = f"must be a known {what}: one of {', '.join(known)}, or module:Class"
        raise SettingsError([Problem(path, repr(name) + (hint and f"; {hint}"), allowed)])
    return installed[name]


def find_controller(mode: str, path: str = "control.mode") -> type[Any]:
    """Find the controller class that `control.mode` names.

    Raises:
        SettingsError: as `find_class`.
    """
    return find_class(
        mode,
        what="controller",
        path=path,
        shipped=CONTROLLERS,
        group=CONTROLLER_GROUP,
        needed=("Settings", "step"),
    )


def controller_settings(mode: str, options: Mapping[str, Any], shared: Any, path: str = "control") -> Any:
    """Check the controller's own settings; `shared` are the agent's.

    A `Settings` class may check its options against `shared` in a method `problems_with(shared)`.

    Raises:
        SettingsError: with every mistake, including those of the class itself.
    """
    controller = find_controller(mode, f"{path}.mode")
    try:
        settings: Any = checked.load(controller.Settings, options, path)
        check = getattr(settings, "problems_with", None)
        problems = [Problem(f"{path}.{p.path}", p.given, p.allowed) for p in (check(shared) if check else None) or ()]
        if "mode" in checked.plain(settings):
            raise SettingsError(
                [Problem(f"{path}.mode", repr(mode), "must have no option called mode in its Settings")]
            )
        if not _is_plain(checked.plain(settings)):
            raise TypeError("a value must be a bool, int, float, str, or tuple of these")
    except SettingsError:
        raise
    except Exception as error:  # a third-party class may raise anything
        needs = "every field has a default and the type bool, int, float, str or tuple[one of these, ...]"
        must = f"must name a controller with valid Settings: {described(error)}; {needs}"
        raise SettingsError([Problem(f"{path}.mode", repr(mode), must)]) from None
    if problems:
        raise SettingsError(problems)
    return settings


def _is_plain(value: Any) -> bool:
    """Whether a settings file can hold the value."""
    if isinstance(value, dict):
        return all(map(_is_plain, value.values()))
    return all(map(_is_plain, value)) if isinstance(value, list) else type(value) in (bool, int, float, str)


def described(error: BaseException) -> str:
    """Describe an error in one line of printable characters."""
    try:
        text = str(error)
    except Exception:
        text = "(without a text)"
    line = " ".join(f"{type(error).__name__}: {text}".split())
    line = "".join(character if character.isprintable() else "?" for character in line[: MAX_DESCRIBED + 1])
    return line if len(line) <= MAX_DESCRIBED else f"{line[: MAX_DESCRIBED - 3]}..."
