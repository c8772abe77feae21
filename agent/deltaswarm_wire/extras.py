"""Optional packages: which extra installs one, and the message if one is missing."""

import re
from importlib.util import find_spec

REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)>=(?P<least>[\d.]+)(; extra == '(?P<extra>\w+)')?")
"""A requirement as a distribution's own metadata states it."""

DISTRIBUTIONS = ("deltaswarm", "deltaswarm-agent")
"""This distribution: all of it, or what a board has."""

NAMES = {
    "dask": "distributed",
    "foxglove": "foxglove-sdk",
    "rerun": "rerun-sdk",
    "serial": "pyserial",
}
"""Distributions by their top-level modules, where the names differ."""

FOR_DEVELOPERS = ("dev", "docs")
LAST = "export"
"""An extra that is named only for packages that no other one has."""


def _requirements() -> tuple[str, list[tuple[str, str, str]]]:
    """Return the name of the installed distribution, and its requirements: extra ("": always), name, least version."""
    from importlib.metadata import PackageNotFoundError, requires  # costs a board 2 MB

    for distribution in DISTRIBUTIONS:
        try:
            matches = [REQUIREMENT.fullmatch(text) for text in requires(distribution) or ()]
        except PackageNotFoundError:
            continue
        return distribution, [(match["extra"] or "", match["name"], match["least"]) for match in matches if match]
    return DISTRIBUTIONS[0], []


def needed(extra: str = "") -> dict[str, str]:
    """Return the least versions of the packages, by name, that this distribution or one of its extras needs."""
    return {name: least for group, name, least in _requirements()[1] if group == extra}


def extras() -> list[str]:
    return list(dict.fromkeys(extra for extra, _, _ in _requirements()[1] if extra and extra not in FOR_DEVELOPERS))


def install(extra: str) -> str:
    return f"pip install '{_requirements()[0]}[{extra}]'"


def missing(*modules: str, extra: str = "") -> str:
    """Return which module is not installed, as "needs X: pip install ..." with an extra; "" if all are there."""
    return next((_needs(module, extra) for module in modules if find_spec(module) is None), "")


def missing_by(error: BaseException | None) -> str:
    """Return the same of the error that an import raised; "" if no requirement is what could not be imported."""
    module = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    name = NAMES.get(module, module)
    return _needs(module) if any(name == required for _, required, _ in _requirements()[1]) else ""


def _needs(module: str, extra: str = "") -> str:
    name = NAMES.get(module, module)
    extra = extra or _extra_of(name)
    return f"needs {name}: {install(extra) if extra else f'pip install {name}'}"


def _extra_of(name: str) -> str:
    having = sorted((extra for extra in extras() if name in needed(extra)), key=lambda extra: extra == LAST)
    return having[0] if having else ""
