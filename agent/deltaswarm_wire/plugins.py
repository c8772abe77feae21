"""Plug-ins: classes found by name, and their options checked by their own `Settings`.

A name is that of a shipped class, of an entry point, or `module:Class`.
"""

import difflib
import importlib
import sys
from collections.abc import Collection, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError

PAPER = "deltaswarm_agent.controllers.paper.controller:PaperController"

CONTROLLERS = {
    "decentralised": PAPER,
    "hierarchical": PAPER,
    "hybrid": PAPER,
    "potential": "deltaswarm_agent.controllers.potential:PotentialController",
}
"""The shipped controllers, by the short names that `control.mode` takes. A new one is a line here."""

BODIES = {
    "kinematic": "deltaswarm_agent.bodies.kinematic:KinematicBody",
    "mavlink": "deltaswarm_agent.bodies.mavlink:MavlinkBody",
}
"""The shipped bodies, by the short names that `body.kind` takes on a board. A new one is a line here."""

MAX_DESCRIBED = 400
"""Characters of a strange error's text."""

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
    """The class that `name` means.

    Args:
        name: a key of `shipped`, an entry point of `group`, or `module:Class`.
        what: what it should be, for messages, such as "controller".
        path: the settings key that holds the name, for messages.
        shipped: `module:Class` by short name, found without a search through all installed packages.
        group: the group of entry points.
        needed: the attributes that such a class has; `Settings` must be a dataclass.
        others: names that mean something elsewhere, for messages.

    Raises:
        SettingsError: there is no such class, it cannot be imported, or it lacks something.
    """
    target = name if ":" in name else shipped.get(name) or _entry_point(name, what, path, shipped, group, others)
    module, _, attribute = target.partition(":")
    try:
        found: Any = getattr(importlib.import_module(module), attribute)
    except (Exception, SystemExit) as error:  # whatever a plug-in's module may raise; a script ends by SystemExit
        told = f"cannot be imported: {described(error)}"
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            told += "; PYTHONPATH must name the folder that the module is in"
        raise SettingsError([Problem(path, repr(name), told)]) from None
    missing = [attribute for attribute in needed if not hasattr(found, attribute)]
    if missing:
        raise SettingsError([Problem(path, repr(name), f"is no {what}: it lacks {', '.join(missing)}")])
    if not (isinstance(found.Settings, type) and is_dataclass(found.Settings)):
        raise SettingsError([Problem(path, repr(name), f"is no {what}: its Settings is no dataclass")])
    cls: type[Any] = found
    return cls


def _entry_point(
    name: str, what: str, path: str, shipped: Mapping[str, str], group: str, others: Collection[str]
) -> str:
    from importlib.metadata import entry_points  # takes a board 2 MB, and most need none

    installed = {point.name: point.value for point in entry_points(group=group)}
    if name not in installed:
        known = sorted({*shipped, *installed, *others})
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        allowed = f"{hint}use one of {', '.join(known)}, or module:Class"
        raise SettingsError([Problem(path, repr(name), f"no such {what}; {allowed}")])
    return installed[name]


def find_controller(mode: str, path: str = "control.mode") -> type[Any]:
    """The controller class that `control.mode` names.

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


def source_digest(mode: str) -> str | None:
    """A digest of the file that holds somebody else's controller; None for a shipped one, which the version tells.

    Raises:
        SettingsError: as `find_class`.
    """
    if mode in CONTROLLERS:
        return None
    import hashlib  # takes a board 4 MB, and no agent needs it

    file = sys.modules[find_controller(mode).__module__].__file__
    return hashlib.blake2b(Path(file).read_bytes(), digest_size=8).hexdigest() if file else None


def controller_settings(mode: str, options: Mapping[str, Any], shared: Any, path: str = "control") -> Any:
    """The controller's own settings, checked; `shared` are the agent's.

    A `Settings` class may have a method `problems_with(shared)` for what its options alone cannot show.

    Raises:
        SettingsError: with every mistake, also those of the class itself.
    """
    found = find_controller(mode, f"{path}.mode")
    try:
        settings: Any = checked.load(found.Settings, options, path)
        check = getattr(settings, "problems_with", None)
        problems = [Problem(f"{path}.{p.path}", p.found, p.allowed) for p in (check(shared) if check else None) or ()]
        if "mode" in checked.plain(settings):
            raise SettingsError([Problem(f"{path}.mode", repr(mode), "no option of its Settings may be called mode")])
        if not _is_plain(checked.plain(settings)):
            raise TypeError("a value is no bool, int, float, str, or tuple of these")
    except SettingsError:
        raise
    except Exception as error:  # whatever somebody else's class may raise
        needs = "a field has a default, and the type bool, int, float, str or tuple[one of these, ...]"
        told = f"its Settings fail: {described(error)}; {needs}"
        raise SettingsError([Problem(f"{path}.mode", repr(mode), told)]) from None
    if problems:
        raise SettingsError(problems)
    return settings


def _is_plain(value: Any) -> bool:
    """Whether a file of settings can hold it."""
    if isinstance(value, dict):
        return all(map(_is_plain, value.values()))
    return all(map(_is_plain, value)) if isinstance(value, list) else type(value) in (bool, int, float, str)


def described(error: BaseException) -> str:
    """An error as one line of printable characters, whatever it holds."""
    try:
        text = str(error)
    except Exception:
        text = "(without a text)"
    line = " ".join(f"{type(error).__name__}: {text}".split())
    line = "".join(character if character.isprintable() else "?" for character in line[: MAX_DESCRIBED + 1])
    return line if len(line) <= MAX_DESCRIBED else f"{line[: MAX_DESCRIBED - 3]}..."
