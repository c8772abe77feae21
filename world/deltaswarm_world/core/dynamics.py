"""Dynamics: how bodies move in a step. The core's own bodies are points; extension packages bring others.

`world.dynamics` names the dynamics of a run by a short name, by an entry point of the group `deltaswarm.dynamics`, or
as `module:Class`. Its options are its own frozen dataclass `Settings` and stand in `[world]`.
"""

import json
from collections.abc import Mapping, Sequence
from math import isfinite
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.foreign import Foreign, name_of
from deltaswarm_wire.plugin_errors import PluginError, defined_at
from deltaswarm_wire.plugins import DYNAMICS, NoSettings, find, own_settings
from deltaswarm_world.core.arrays import Floats, Mask, checked_agents, checked_mask, checked_rows
from deltaswarm_world.core.faults.kind import ActiveFault
from deltaswarm_world.core.obstacles import Obstacles

NOBODY_HIT: frozenset[int] = frozenset()
NO_CRASHES: Mapping[int, str] = MappingProxyType({})
VALUES = ("starts_m", "bumped", "blocked", "crashes", "totals")
"""Members that are no methods."""


class BodyState(NamedTuple):
    """What a recording shows of a body besides its position: heading [rad; from x to y], wheel speeds [m/s].

    Of one that flies also the height above the ground [m], and roll to the right and pitch up [rad].
    """

    heading_rad: float
    left_mps: float
    right_mps: float
    height_m: float | None = None
    roll_rad: float | None = None
    pitch_rad: float | None = None


class Dynamics(Protocol):
    """The bodies of one run. It is part of a checkpoint, so it must be picklable with all that the next step needs.

    A `Settings` class may have a method `problems_with(scenario: Scenario) -> list[Problem]`, called before the run.
    """

    Settings: ClassVar[type[Any]]
    """A frozen dataclass whose fields are made by `deltaswarm_wire.checked.key`.

    A field `radius_m` is also told to the agents, as the radius of their own bodies.
    """
    starts_m: Floats | None
    """Positions (n, 2) of the bodies before the first step [m; world frame]; None: they are drawn."""
    bumped: frozenset[int]
    """Agents whose body touched another body, an obstacle or the arena's edge in the last step."""
    blocked: frozenset[int]
    """Agents whose body something kept from moving as commanded in the last step."""
    crashes: Mapping[int, str]
    """How bodies crashed so far, by agent; an agent fails by it before the next step. May be left out."""

    # Two class attributes may be there as well: `UNSAVED`, a text that says why the bodies cannot be part of a
    # checkpoint, and `to_process`, whether they crash, which ends processes of agents.

    def __init__(self, settings: Any, scenario: Scenario, obstacles: Obstacles) -> None: ...

    def misplaced(self, places_m: Floats) -> Mask:
        """Return which of the drawn starting positions (n, 2) [m; world frame] must be drawn again."""

    def move(self, positions_m: Floats, velocities_mps: Floats, faults: Sequence[ActiveFault]) -> Floats:
        """Return the positions (n, 2) [m] after a step, from those before and the commanded velocities [m/s].

        `faults` are all active faults; those that change commands have done so.
        """

    def states(self) -> Sequence[BodyState] | None:
        """Return each body's state after the last step; None for points."""

    @property
    def totals(self) -> dict[str, Any]:
        """Return what the summary of a run says about its bodies; empty for points.

        It is read and checked before the first step, too.
        """


class Points:
    """Points that move exactly as commanded, and stop at obstacles and the arena's edge."""

    Settings = NoSettings
    starts_m = None
    bumped = blocked = NOBODY_HIT
    crashes = NO_CRASHES

    def __init__(self, settings: NoSettings, scenario: Scenario, obstacles: Obstacles) -> None:
        self._step_s = scenario.run.step_s
        self._size_m = np.array([scenario.arena.width_m, scenario.arena.height_m])
        self._obstacles = obstacles

    def misplaced(self, places_m: Floats) -> Mask:
        return self._obstacles.inside(places_m)

    def move(self, positions_m: Floats, velocities_mps: Floats, faults: Sequence[ActiveFault]) -> Floats:
        moved = positions_m + velocities_mps * self._step_s
        moved = np.minimum(np.maximum(moved, 0.0), self._size_m)  # much faster than np.clip
        return self._obstacles.stop(positions_m, moved) if self._obstacles else moved

    def states(self) -> None:
        """See `Dynamics`."""

    @property
    def totals(self) -> dict[str, Any]:
        return {}


Room = tuple[int, float, float]
"""Number of agents; width and height of the arena [m]."""


def _places(room: Room, value: Any, *arguments: Any) -> Floats:
    agents, *size_m = room
    return checked_rows(value, agents, "give positions [m] within the arena", 0.0, np.array(size_m))


def _states(room: Room, value: Any) -> Sequence[BodyState] | None:
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != room[0]:
        raise ValueError(f"must return None or a state for each of {room[0]} bodies (got {value!r:.80})")
    if wrong := [state for state in value if not (isinstance(state, BodyState) and _is_finite(state))]:
        raise ValueError(f"must return a BodyState of finite numbers for each body (got {wrong[0]!r:.80})")
    return value


def _is_finite(state: BodyState) -> bool:
    return all(map(isfinite, state[:3])) and all(number is None or isfinite(number) for number in state[3:])


def _crashes(room: Room, value: Any) -> Mapping[int, str]:
    if not isinstance(value, Mapping) or not all(type(how) is str and how for how in value.values()):
        raise ValueError(f"must give a text for each crashed agent (got {value!r:.80})")
    checked_agents(frozenset(value), room[0])
    return value


def _totals(_: Room, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"must be a dict (got {value!r:.80})")
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"must have finite numbers, texts, lists and dicts alone ({error})") from None
    return value


class ForeignDynamics(Foreign):
    CHECKS: ClassVar = {
        "starts_m": lambda room, value: value if value is None else _places(room, value),
        "misplaced": lambda room, value, places_m: checked_mask(value, room[0], "the positions"),
        "move": _places,
        **dict.fromkeys(("bumped", "blocked"), lambda room, value: checked_agents(value, room[0])),
        "states": _states,
        "totals": _totals,
        "crashes": _crashes,
    }

    @property
    def crashes(self) -> Any:
        return self.__getattr__("crashes") if hasattr(self._plugin, "crashes") else NO_CRASHES


def dynamics_of(scenario: Scenario, obstacles: Obstacles) -> Dynamics:
    """Make the scenario's dynamics.

    Raises:
        SettingsError: there are none of this name, or their options are wrong.
        PluginError: dynamics from outside fail, or a member is missing or wrong.
    """
    world = scenario.world
    settings = own_settings(DYNAMICS, world.dynamics, world.options, "world", "dynamics", scenario)
    room = scenario.agents.count, scenario.arena.width_m, scenario.arena.height_m
    cls = find(DYNAMICS, world.dynamics, "world.dynamics")
    dynamics: Dynamics = ForeignDynamics.make(cls, settings, scenario, obstacles, context=room)
    if isinstance(dynamics, ForeignDynamics):
        for member in VALUES:  # before hours are spent
            if callable(getattr(dynamics, member)):
                must = f"{name_of(cls)}.{member} must be an attribute or a property, not a method"
                raise PluginError(f"{must} ({defined_at(cls)})")
    return dynamics
