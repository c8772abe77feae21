"""A controller's own numbers: which it declares, and their way from its agents to the tables of a run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.messages import MAX_METRIC_NAME, MAX_METRICS, METRIC_LIMIT
from deltaswarm_wire.plugins import CONTROLLERS, find_controller

STEP, RUN = "step", "run"

PREFIX = "controller_"
"""How the columns of these numbers begin in a table of steps; in a summary their names follow `controller.`."""


@dataclass(frozen=True)
class ControllerMetric:
    """One number of a controller. In each step the swarm's is the mean over the agents that decide and have one.

    Args:
        name: an identifier, by which the controller's `metrics` hold it.
        meaning: what it is, in a few words, for axes and tables.
        unit: its unit.
        per: what its number for a run is: "step", the mean over the steps; "run", that of the last step, in which all
            agents decide.
    """

    name: str
    meaning: str
    unit: str = ""
    per: str = STEP

    @property
    def column(self) -> str:
        """Its column in a table of steps."""
        return PREFIX + self.name

    @property
    def key(self) -> str:
        """Its name in a summary and in studies."""
        return f"controller.{self.name}"


def declared(mode: str) -> tuple[ControllerMetric, ...]:
    """Return the numbers that the controller of `control.mode` declares in `Metrics`; it may have none."""
    if mode in CONTROLLERS.shipped:
        return ()
    metrics = getattr(find_controller(mode), "Metrics", ())
    if wrong := _wrong(metrics):
        raise SettingsError([Problem("control.mode", repr(mode), f"must be a controller whose Metrics are {wrong}")])
    return tuple(metrics)


def _wrong(metrics: Any) -> str:
    """Return what must hold of metrics and does not; empty if they are well."""
    if not isinstance(metrics, tuple | list) or not all(isinstance(one, ControllerMetric) for one in metrics):
        return "a tuple of ControllerMetric"
    names = [one.name for one in metrics]
    if len(names) > MAX_METRICS or len(set(names)) < len(names):
        return f"at most {MAX_METRICS}, each with a name of its own (got {', '.join(map(str, names))})"
    for one in metrics:
        is_name = isinstance(one.name, str) and one.name.isascii() and one.name.isidentifier()
        if not is_name or len(one.name) > MAX_METRIC_NAME:
            return f"named by identifiers of at most {MAX_METRIC_NAME} ASCII characters (got {one.name!r})"
        if one.per not in (STEP, RUN):
            return f"per {STEP!r} or {RUN!r} (got {one.per!r} of {one.name})"
        if not all(isinstance(text, str) and text.isprintable() for text in (one.meaning, one.unit)):
            return f"described by a printable meaning and unit (got {one.meaning!r}, {one.unit!r} of {one.name})"
    return ""


Own = tuple[tuple[str, float], ...]
"""Names and values of an agent in one step."""


def values_of(metrics: Sequence[ControllerMetric], values: Any) -> Own:
    """Return those of a controller's `metrics` that it has in this step; None stands for no number."""
    if not isinstance(values, Mapping):
        raise TypeError(f"metrics must be a mapping of names to numbers (got {type(values).__name__})")
    if unknown := values.keys() - {one.name for one in metrics}:
        raise ValueError(f"metrics must be declared in Metrics (got {sorted(map(str, unknown))[0]!r})")
    found = []
    for one in metrics:
        value = values.get(one.name)
        if value is None:
            continue
        number = float(value)
        if not abs(number) <= METRIC_LIMIT:
            raise ValueError(f"metrics must be finite (got {one.name} = {number})")
        found.append((one.name, number))
    return tuple(found)


def mean_of(names: Sequence[str], agents: Sequence[Own]) -> dict[str, float | None]:
    """Return the mean over agents of each number, None where no agent has it; other names are ignored."""
    given: dict[str, list[float]] = {name: [] for name in names}
    for own in agents:
        for name, value in own:
            if name in given:
                given[name].append(value)
    return {name: math.fsum(values) / len(values) if values else None for name, values in given.items()}
