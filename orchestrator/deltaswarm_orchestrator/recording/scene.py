"""What a viewer shows of one step: frames of reference, and agents, trees, links and events as shapes.

One entity per topic holds all its shapes: each message replaces the one before as a whole, so that
nothing needs to be deleted, also when a viewer jumps in time.
"""

import zlib
from collections.abc import Iterable, Mapping
from typing import Any

import orjson

from deltaswarm_orchestrator.recording.foxglove import ARENA_FRAME, ROOT_FRAME, Json
from deltaswarm_wire.messages import NOBODY
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.truth import DEAD, Body, EventState, Truth

EPOCH_S = 946_684_800
"""Simulated time 0 is 2000-01-01T00:00:00Z in every recording, so that runs align."""

ROLE_COLOURS = {
    "free": "#56b4e9",
    "attending": "#e69f00",
    "root": "#d55e00",
    "member": "#0072b2",
    "orphan": "#cc79a7",
    "relocating": "#009e73",
    "leaving": "#f0e442",
    "dead": "#999999",
}
"""Okabe and Ito's palette, which the colour-blind can tell apart; black is for events."""

OTHER_COLOURS = ("#88ccee", "#ddcc77", "#cc6677", "#117733", "#aa4499", "#44aa99", "#882255")
"""Paul Tol's muted palette, for roles of other controllers."""


def role_colour(role: str) -> str:
    """The colour of a role, known or not: the same in every recording."""
    return ROLE_COLOURS.get(role) or OTHER_COLOURS[zlib.crc32(role.encode()) % len(OTHER_COLOURS)]


MAX_LOOKS = 256
"""Roles whose look is kept ready."""

LINE_LOOP, LINE_LIST = 1, 2

_SIZE_OF_ARENA = {"agent": 0.014, "root": 0.022, "event": 0.018}
"""Diameters as shares of the arena's longest side, to be seen in an arena of any size."""

_TREE_PX, _LINK_PX, _WALL_PX = 3.0, 1.0, 2.0


def log_time_ns(time_s: float) -> int:
    """Simulated time as nanoseconds since 1970, with EPOCH_S as its zero."""
    return EPOCH_S * 1_000_000_000 + round(time_s * 1e9)


def stamp(time_s: float) -> dict[str, int]:
    """Simulated time as the time of a Foxglove schema."""
    seconds, nanoseconds = divmod(log_time_ns(time_s), 1_000_000_000)
    return {"sec": seconds, "nsec": nanoseconds}


def colour(code: str, alpha: float = 1.0) -> dict[str, float]:
    """A Foxglove colour of `#rrggbb`."""
    red, green, blue = (round(int(code[i : i + 2], 16) / 255, 3) for i in (1, 3, 5))
    return {"r": red, "g": green, "b": blue, "a": alpha}


def _vector(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def _ready(value: Any) -> orjson.Fragment:
    """Encoded once, for what is the same in every step."""
    return orjson.Fragment(orjson.dumps(value))


_UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_HERE = {"position": _vector(0.0, 0.0), "orientation": _UPRIGHT}
_NO_SHAPES = {
    shape: _ready([]) for shape in ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
}


class Scene:
    """Makes the messages of the view topics. Places in m, to the millimetre, in the arena's frame."""

    def __init__(self, scenario: Scenario) -> None:
        width_m, height_m = scenario.arena.width_m, scenario.arena.height_m
        self._work_agent_s = scenario.events.work_agent_s
        self._upright = _ready(_UPRIGHT)
        self._head = {
            "frame_id": ARENA_FRAME,
            "lifetime": _ready({"sec": 0, "nsec": 0}),
            "frame_locked": True,
            "metadata": _ready([]),
            **_NO_SHAPES,
        }
        self._arena = {
            "parent_frame_id": ROOT_FRAME,
            "child_frame_id": ARENA_FRAME,
            "translation": _vector(-width_m / 2, -height_m / 2),
            "rotation": self._upright,
        }
        corners = [_vector(x, y) for x, y in ((0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m))]
        obstacles = [[_vector(x, y) for x, y in obstacle.corners_m] for obstacle in scenario.arena.obstacles]
        loops = [corners, *obstacles]
        self._walls = [_ready(_line(LINE_LOOP, loop, [], _WALL_PX, colour("#000000"))) for loop in loops]
        size_m = {kind: share * max(width_m, height_m) for kind, share in _SIZE_OF_ARENA.items()}
        self._size_m = size_m
        self._looks: dict[str, Json] = {}
        self._event_size_m = size_m["event"]
        self._event_colours = {
            waiting: _ready(colour("#000000", alpha)) for waiting, alpha in ((True, 1.0), (False, 0.6))
        }
        self._tree_colour = _ready(colour(ROLE_COLOURS["member"], 0.8))
        self._link_colour = _ready(colour("#666666", 0.35))
        self._names: dict[int, str] = {}

    def messages(self, truth: Truth) -> Iterable[tuple[str, Json]]:
        """Topic and message of each view of this step."""
        now = _ready(stamp(truth.time_s))
        places = [_vector(round(body.x_m, 3), round(body.y_m, 3)) for body in truth.bodies]
        yield "/tf", {"transforms": self._transforms(truth.bodies, places, now)}
        agents = self._agents(truth.bodies, places)
        yield "/scene/agents", self._update("agents", now, spheres=agents, lines=self._walls)
        points = _ready(places)
        index = {body.agent: i for i, body in enumerate(truth.bodies)}
        parents = ((body.agent, body.parent) for body in truth.bodies if body.parent != NOBODY)
        tree = _between(points, _pairs(parents, index), _TREE_PX, self._tree_colour)
        yield "/scene/tree", self._update("tree", now, lines=tree)
        links = _between(points, _pairs(truth.links, index), _LINK_PX, self._link_colour)
        yield "/scene/links", self._update("links", now, lines=links)
        events = [self._event(event) for event in truth.events if event.completed_s is None]
        yield "/scene/events", self._update("events", now, cylinders=events)

    def _update(self, name: str, now: orjson.Fragment, **shapes: list[Any]) -> Json:
        return {"deletions": [], "entities": [{"id": name, "timestamp": now, **self._head, **shapes}]}

    def _transforms(self, bodies: Iterable[Body], places: Iterable[Json], now: orjson.Fragment) -> list[Json]:
        """The arena in the world, always, since a viewer may start anywhere; then each agent in the arena."""
        transforms = [{"timestamp": now, **self._arena}]
        transforms += [
            {
                "timestamp": now,
                "parent_frame_id": ARENA_FRAME,
                "child_frame_id": self._name(body.agent),
                "translation": place,
                "rotation": self._upright,
            }
            for body, place in zip(bodies, places, strict=True)
        ]
        return transforms

    def _name(self, agent: int) -> str:
        name = self._names.get(agent)
        if name is None:
            name = self._names[agent] = f"agent/{agent}"
        return name

    def _agents(self, bodies: Iterable[Body], places: Iterable[Json]) -> list[Json]:
        upright = self._upright
        return [
            {"pose": {"position": place, "orientation": upright}, **self._look(body.role)}
            for body, place in zip(bodies, places, strict=True)
        ]

    def _look(self, role: str) -> Json:
        if role not in self._looks:
            if len(self._looks) >= MAX_LOOKS:
                self._looks.clear()
            self._looks[role] = _agent_look(role, self._size_m)
        return self._looks[role]

    def _event(self, event: EventState) -> Json:
        """A black disc that shrinks with the work done; paler once sensed."""
        left = max(0.0, 1.0 - event.work_agent_s / self._work_agent_s)
        diameter_m = round(self._event_size_m * (0.4 + 0.6 * left), 3)
        place = _vector(round(event.x_m, 3), round(event.y_m, 3))
        return {
            "pose": {"position": place, "orientation": self._upright},
            "size": _vector(diameter_m, diameter_m, 0.1),
            "bottom_scale": 1.0,
            "top_scale": 1.0,
            "color": self._event_colours[event.sensed_s is None],
        }


def _agent_look(role: str, size_m: Mapping[str, float]) -> Json:
    """Size and colour; a root is larger, so that it stands out without colour, too."""
    diameter_m = size_m["root" if role == "root" else "agent"]
    alpha = 0.4 if role == DEAD else 1.0
    return {"size": _ready(_vector(*[diameter_m] * 3)), "color": _ready(colour(role_colour(role), alpha))}


def _pairs(pairs: Iterable[tuple[int, int]], index: Mapping[int, int]) -> list[int]:
    """Ends of the lines as places in a list of points. A parent is hearsay: one that is not there has no line."""
    return [index[agent] for pair in pairs if pair[0] in index and pair[1] in index for agent in pair]


def _between(points: Any, indices: list[int], thickness_px: float, colour: Any) -> list[Json]:
    """Lines from point to point, or none: a line without ends is an error to some viewers."""
    return [_line(LINE_LIST, points, indices, thickness_px, colour)] if indices else []


def _line(kind: int, points: Any, indices: list[int], thickness_px: float, colour: Any) -> Json:
    return {
        "type": kind,
        "pose": _HERE,
        "thickness": thickness_px,
        "scale_invariant": True,
        "points": points,
        "color": colour,
        "colors": [],
        "indices": indices,
    }
