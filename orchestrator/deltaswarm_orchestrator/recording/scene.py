"""Make what a viewer shows of one step: frames, and agents, trees, links and events as shapes and as points.

One entity per topic holds all shapes of the topic. Each message replaces the one before entirely, so nothing needs to
be deleted, even when a viewer jumps in time.

Messages are reused and their numbers changed in place, because making new ones takes several times as long. A message
whose size changes is copied instead, because a message frees its memory only when it is deleted as a whole.
"""

import math
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive

from deltaswarm_orchestrator.recording.schemas import AGENT_FIELDS, ARENA_FRAME, OURS, ROOT_FRAME
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import BODY_FIELDS, DEAD, AgentState, EventState, Truth
from deltaswarm_wire.messages import NOBODY

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
"""Okabe and Ito's palette, which colour-blind people can tell apart; black is for events."""

OTHER_COLOURS = ("#88ccee", "#ddcc77", "#cc6677", "#117733", "#aa4499", "#44aa99", "#882255")
"""Paul Tol's muted palette, for roles of other controllers."""

EVENTS = "events"
OPAQUE = b"\xff"
EVENT_RGBA = b"\xa0\x52\x2d" + OPAQUE
"""Colour of events drawn as points: a brown, visible on a black background and on a white one."""

MAX_LOOKS = 256
"""Number of roles whose look is cached."""

PLACE_STEPS_PER_M = 1024
"""Positions are rounded to about a millimetre, and to few binary digits, which compress well."""

_SIZE_OF_ARENA = {"agent": 0.014, "root": 0.022, "event": 0.018}
"""Diameters as shares of the arena's longest side, visible in an arena of any size."""

_TREE_PX, _LINK_PX, _WALL_PX, _HEADING_PX = 3.0, 1.0, 2.0, 2.0

HEADING_RADII = 1.4
"""Length of the line that shows a heading, in radii."""

_POINT = struct.Struct("<fff4s")
_UPRIGHT = {"w": 1.0}
_HERE = {"position": {}, "orientation": _UPRIGHT}

Place = tuple[float, float]


def role_colour(role: str) -> str:
    """Return the colour of a role, known or not; it is the same in every recording."""
    return ROLE_COLOURS.get(role) or OTHER_COLOURS[zlib.crc32(role.encode()) % len(OTHER_COLOURS)]


@lru_cache(maxsize=4)  # all messages of a step ask for the same time
def log_time_ns(time_s: float) -> int:
    """Convert simulated time [s] to nanoseconds since 1970, with EPOCH_S as zero."""
    return EPOCH_S * 1_000_000_000 + round(time_s * 1e9)


def stamp(time_s: float) -> dict[str, int]:
    """Convert simulated time [s] to the fields of a timestamp."""
    seconds, nanos = divmod(log_time_ns(time_s), 1_000_000_000)
    return {"seconds": seconds, "nanos": nanos}


def colour(code: str, alpha: float = 1.0) -> Color:
    """Make a Foxglove colour from `#rrggbb`."""
    red, green, blue = (round(int(code[i : i + 2], 16) / 255, 3) for i in (1, 3, 5))
    return Color(r=red, g=green, b=blue, a=alpha)


class Scene:
    """Makes the messages of the view topics. Positions are in m, in the arena's frame."""

    def __init__(self, scenario: Scenario) -> None:
        width_m, height_m = scenario.arena.width_m, scenario.arena.height_m
        self._work_agent_s = scenario.events.work_agent_s
        self._size_m = {kind: share * max(width_m, height_m) for kind, share in _SIZE_OF_ARENA.items()}
        self._radius_m = radius_m = scenario.world.radius_m
        if radius_m:  # bodies that take up room are as large as they are
            self._size_m |= {"agent": 2.0 * radius_m, "root": 2.0 * radius_m}
        self._look = lru_cache(MAX_LOOKS)(lambda role: _agent_look(role, self._size_m))
        self._arena = _transform(ROOT_FRAME, ARENA_FRAME, (-width_m / 2, -height_m / 2))
        self._transforms = FrameTransforms()
        self._points = LinePrimitive()
        self._agents: list[int] | None = None
        self._tree_statuses: list[tuple[Any, ...]] | None = None
        self._times: list[Any] = []
        """The timestamp of each frame."""
        self._places: list[tuple[Any, Any, Any]] = []
        """Each agent's position as a frame, as a sphere, and as an endpoint of lines."""
        self._looks: list[tuple[str, Any, Any]] = []
        """For each agent, the role whose look its sphere has, and the sphere's size and colour."""
        self._headings = _line(LinePrimitive.LINE_LIST, _HEADING_PX, colour("#000000"))
        """A line from each body's centre to beyond its edge, on top of it."""
        self._walls = 0
        """Number of lines in the scene of the agents that never change."""
        self._discs: list[CylinderPrimitive] = []
        """As many discs as there have ever been events at a time."""
        corners = [(0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m)]
        loops: list[Sequence[Any]] = [corners, *(obstacle.corners_m for obstacle in scenario.arena.obstacles)]
        walls = [_line(LinePrimitive.LINE_LOOP, _WALL_PX, colour("#000000"), loop) for loop in loops]
        self._walls = len(walls)
        names = ("agents", "tree", "links", EVENTS)
        self._updates = {name: _update(name, walls if name == "agents" else ()) for name in names}
        """The update of the agents is changed in place; the others are copied."""
        self._lines = {
            "tree": _line(LinePrimitive.LINE_LIST, _TREE_PX, colour(ROLE_COLOURS["member"], 0.8)),
            "links": _line(LinePrimitive.LINE_LIST, _LINK_PX, colour("#666666", 0.35)),
        }

    def messages(self, truth: Truth) -> Iterator[tuple[str, bytes]]:
        """Yield topic and message of each view of this step; `/swarm/agents` only if it changed."""
        now = stamp(truth.time_s)
        places = _rounded(truth.bodies)
        agents = [body.agent for body in truth.bodies]
        roles = [body.role for body in truth.bodies]
        if agents != self._agents:
            self._make_messages(agents)
        steps = PLACE_STEPS_PER_M
        heights_m = [round(body.height_m * steps) / steps if body.height_m else 0.0 for body in truth.bodies]
        self._place_agents(roles, places, now)
        if has_headings := any(body.heading_rad is not None for body in truth.bodies):
            self._turn_agents(truth.bodies, places, heights_m)
        yield "/tf", self._transforms.SerializeToString()
        yield "/scene/agents", _encoded(self._updates["agents"], now)
        index = {agent: place for place, agent in enumerate(agents)}
        parents = [(body.agent, body.parent) for body in truth.bodies if body.parent != NOBODY]
        yield "/scene/tree", _encoded(self._connected("tree", parents, index), now)
        yield "/scene/links", _encoded(self._connected("links", truth.links, index), now)
        events = [event for event in truth.events if event.completed_s is None]
        event_places = _rounded(events)
        yield "/scene/events", _encoded(self._events(events, event_places), now)
        yield "/points/agents", _points(places, heights_m, [role_rgba(role) for role in roles], now)
        yield "/points/events", _points(event_places, [0.0] * len(events), [EVENT_RGBA] * len(events), now)
        standings = [body[3:] for body in truth.bodies]
        if standings != self._tree_statuses:
            self._tree_statuses = standings
            shown = [*AGENT_FIELDS, *BODY_FIELDS] if has_headings else AGENT_FIELDS
            columns = {name: [getattr(body, name) for body in truth.bodies] for name in shown}
            agents_message = OURS["Agents"](step=truth.step, time_s=truth.time_s, **columns)
            yield "/swarm/agents", agents_message.SerializeToString()

    def _make_messages(self, agents: list[int]) -> None:
        self._agents, self._tree_statuses = agents, None
        frames = [_transform(ARENA_FRAME, f"agent/{agent}", (0.0, 0.0)) for agent in agents]
        # The arena's frame comes with each message, since a viewer may start anywhere.
        self._transforms = FrameTransforms(transforms=[self._arena, *frames])
        self._times = [frame.timestamp for frame in self._transforms.transforms]
        spheres = self._updates["agents"].entities[0].spheres
        del spheres[:]
        spheres.extend([SpherePrimitive(pose=_HERE, size={}, color={})] * len(agents))
        self._looks = [("", sphere.size, sphere.color) for sphere in spheres]
        self._points = LinePrimitive(points=[{}] * len(agents))
        translations = [frame.translation for frame in self._transforms.transforms[1:]]
        positions = [sphere.pose.position for sphere in spheres]
        self._places = list(zip(translations, positions, self._points.points, strict=True))

    def _place_agents(self, roles: list[str], places: list[Place], now: Mapping[str, int]) -> None:
        seconds, nanos = now["seconds"], now["nanos"]
        for timestamp in self._times:
            timestamp.seconds, timestamp.nanos = seconds, nanos
        for i, (role, (shown, size, shade)) in enumerate(zip(roles, self._looks, strict=True)):
            if role != shown:
                size.x, shade.r, shade.g, shade.b, shade.a = self._look(role)
                size.y = size.z = size.x
                self._looks[i] = role, size, shade
        for (frame, sphere, end), (x, y) in zip(self._places, places, strict=True):
            frame.x = sphere.x = end.x = x
            frame.y = sphere.y = end.y = y

    def _turn_agents(self, bodies: Sequence[AgentState], places: list[Place], heights_m: list[float]) -> None:
        ends, turns = self._headings.points, [frame.rotation for frame in self._transforms.transforms[1:]]
        while len(ends) < 2 * len(places):
            ends.add(z=self._radius_m)
        reach_m = HEADING_RADII * self._radius_m
        for i, (body, turn, (x, y), z) in enumerate(zip(bodies, turns, places, heights_m, strict=True)):
            heading = body.heading_rad or 0.0
            turn.z, turn.w = math.sin(heading / 2), math.cos(heading / 2)
            if body.height_m is not None:
                turn.x, turn.y, turn.z, turn.w = quaternion(body)
                ends[2 * i].z = ends[2 * i + 1].z = z + self._radius_m
                for place in self._places[i]:
                    place.z = z
            ends[2 * i].x, ends[2 * i].y = x, y
            ends[2 * i + 1].x, ends[2 * i + 1].y = x + reach_m * math.cos(heading), y + reach_m * math.sin(heading)
        lines = self._updates["agents"].entities[0].lines
        del lines[self._walls :]
        lines.append(self._headings)

    def _connected(self, name: str, pairs: Iterable[tuple[int, int]], index: Mapping[int, int]) -> SceneUpdate:
        """Draw lines between pairs of agents, or no line primitive at all: some viewers reject an empty one.

        The parent that an agent reports may not exist; then no line is drawn.
        """
        update = SceneUpdate()
        update.CopyFrom(self._updates[name])
        ends = [index[agent] for pair in pairs if pair[0] in index and pair[1] in index for agent in pair]
        if ends:
            line = update.entities[0].lines.add()
            line.CopyFrom(self._points)
            line.MergeFrom(self._lines[name])
            line.indices.extend(ends)
        return update

    def _events(self, events: list[EventState], places: list[Place]) -> SceneUpdate:
        """Draw a black disc for each event. It shrinks with the work done, and is paler once sensed."""
        while len(self._discs) < len(events):
            self._discs.append(
                CylinderPrimitive(pose=_HERE, size={"z": 0.1}, bottom_scale=1.0, top_scale=1.0, color={})
            )
        for disc, event, (x, y) in zip(self._discs, events, places, strict=False):
            left = max(0.0, 1.0 - event.work_agent_s / self._work_agent_s)
            position, size = disc.pose.position, disc.size
            position.x, position.y = x, y
            size.x = size.y = round(self._size_m["event"] * (0.4 + 0.6 * left), 3)
            disc.color.a = 1.0 if event.sensed_s is None else 0.6
        update = SceneUpdate()
        update.CopyFrom(self._updates[EVENTS])
        update.entities[0].cylinders.extend(self._discs[: len(events)])
        return update


@lru_cache(MAX_LOOKS)
def role_rgba(role: str) -> bytes:
    return bytes.fromhex(role_colour(role)[1:]) + OPAQUE


def quaternion(body: AgentState) -> tuple[float, float, float, float]:
    """Return the rotation (x, y, z, w) from the arena's axes to those of a body: ahead, to the left, up."""
    yaw, roll = (body.heading_rad or 0.0) / 2, (body.roll_rad or 0.0) / 2
    down = -(body.pitch_rad or 0.0) / 2
    (sy, cy), (sr, cr), (sd, cd) = ((math.sin(half), math.cos(half)) for half in (yaw, roll, down))
    return (
        sr * cd * cy - cr * sd * sy,
        cr * sd * cy + sr * cd * sy,
        cr * cd * sy - sr * sd * cy,
        cr * cd * cy + sr * sd * sy,
    )


def _rounded(things: Iterable[AgentState | EventState]) -> list[Place]:
    steps = PLACE_STEPS_PER_M
    return [(round(thing.x_m * steps) / steps, round(thing.y_m * steps) / steps) for thing in things]


def _encoded(update: SceneUpdate, now: Mapping[str, int]) -> bytes:
    timestamp = update.entities[0].timestamp
    timestamp.seconds, timestamp.nanos = now["seconds"], now["nanos"]
    return bytes(update.SerializeToString())


def _transform(parent: str, child: str, place: Place) -> FrameTransform:
    translation = {"x": place[0], "y": place[1]}
    return FrameTransform(parent_frame_id=parent, child_frame_id=child, translation=translation, rotation=_UPRIGHT)


def _update(name: str, lines: Iterable[LinePrimitive]) -> SceneUpdate:
    """Make an update of one entity, which lives until the next message replaces it."""
    entity = {"id": name, "frame_id": ARENA_FRAME, "lifetime": {}, "frame_locked": True, "lines": lines}
    return SceneUpdate(entities=[entity])


def _line(kind: Any, thickness_px: float, colour: Color, places: Iterable[Place] = ()) -> LinePrimitive:
    points = [{"x": x, "y": y} for x, y in places]
    line = {"pose": _HERE, "thickness": thickness_px, "scale_invariant": True, "color": colour, "points": points}
    return LinePrimitive(type=kind, **line)


def _cloud_head() -> bytes:
    """Encode what all clouds of `_POINT`s share. A message's bytes may be the concatenated bytes of its parts."""
    floats = [{"name": name, "offset": 4 * i, "type": PackedElementField.FLOAT32} for i, name in enumerate("xyz")]
    names = ("red", "green", "blue", "alpha")
    octets = [{"name": name, "offset": 12 + i, "type": PackedElementField.UINT8} for i, name in enumerate(names)]
    head = PointCloud(frame_id=ARENA_FRAME, pose=_HERE, point_stride=_POINT.size, fields=[*floats, *octets])
    return bytes(head.SerializeToString())


_CLOUD_HEAD = _cloud_head()


def _points(places: list[Place], heights_m: list[float], colours: list[bytes], now: Mapping[str, int]) -> bytes:
    pack = _POINT.pack
    data = b"".join([pack(x, y, z, rgba) for (x, y), z, rgba in zip(places, heights_m, colours, strict=True)])
    return _CLOUD_HEAD + bytes(PointCloud(timestamp=now, data=data).SerializeToString())


def _agent_look(role: str, size_m: Mapping[str, float]) -> tuple[float, ...]:
    """Return diameter and colour of a role; a root is larger, so that it stands out even without colour."""
    shade = colour(role_colour(role), 0.4 if role == DEAD else 1.0)
    return size_m["root" if role == "root" else "agent"], shade.r, shade.g, shade.b, shade.a
