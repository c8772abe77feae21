"""Stand-in ROS 2 robots, written from the documents of ROS 2, rmw_zenoh and zenoh-plugin-ros2dds alone.

`fleet(port, "/robot1", ...)` is a Zenoh router and, each with a session of its own, robots that publish `odom` at 20 Hz
and follow `cmd_vel`; with `sim_time`, as if in a simulator, which publishes `/clock`. They share no code of messages
and keys with deltaswarm: keys and tokens are written out here, messages are rosbags'. What deviates from the documents
is in `Robot.complaints`: a key, a token, an attachment, a byte of a message, a motion that such a robot cannot do.

The documents: rmw_zenoh's docs/design.md (keys, liveliness tokens, attachments), the plugin's README.md (keys),
nav_msgs/Odometry, geometry_msgs/Twist and REP 103 (frames and units).
"""

import json
import math
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from typing import Any

from deltaswarm_wire.session import use_one_worker_thread
from tests.support.ros2_types import STORE, bag_decoded, bag_encoded

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

PERIOD_S = 0.05
TIMEOUT_S = 0.5
"""Time without a command after which a robot stands, as diff_drive_controller does [s]."""

TOKENS_S = 20.0
"""A publisher's tokens may come later than its first messages, but not by this time [s]."""

FASTEST_MPS, FASTEST_RADPS = 2.0, 1.5

ODOMETRY, CLOCK = "nav_msgs/msg/Odometry", "rosgraph_msgs/msg/Clock"
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
POSE_STAMPED, POSE_ARRAY = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseArray"


@dataclass(frozen=True)
class Kind:
    """What the robots of a fleet have in common."""

    layout: str = "rmw_zenoh"
    domain: int = 0
    odometry_type: str = ODOMETRY
    command_type: str = TWIST
    is_holonomic: bool = False
    sim_time: bool = False


class Clock:
    """The robots' time: of the machine, or of a simulator that began with 100 s and can be paused."""

    def __init__(self, is_simulated: bool) -> None:
        self.is_paused = False
        self._simulated_ns = 100_000_000_000 if is_simulated else None

    def advance(self, for_s: float) -> None:
        """Let time pass."""
        if self._simulated_ns is not None and not self.is_paused:
            self._simulated_ns += round(for_s * 1e9)

    def stamp(self) -> dict[str, int]:
        """The time as ROS has it."""
        time_ns = time.time_ns() if self._simulated_ns is None else self._simulated_ns
        sec, nanosec = divmod(time_ns, 1_000_000_000)
        return {"sec": sec, "nanosec": nanosec}


def dds_name(message_type: str) -> str:
    package, _, name = message_type.split("/")
    return f"{package}::msg::dds_::{name}_"


def session(mode: str, endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    for name, value in (
        ("mode", mode),
        ("listen/endpoints" if mode == "router" else "connect/endpoints", [endpoint]),
        ("scouting/multicast/enabled", False),
        ("transport/shared_memory/enabled", False),
    ):
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


class Robot:
    """One robot: a unicycle whose place and heading [m, rad] are its odometry."""

    def __init__(self, name: str, port: int, kind: Kind, clock: Clock) -> None:
        self.name = name
        self.x_m, self.y_m, self.heading_rad = 0.0, 0.0, 0.0
        self.speed_mps = self.left_mps = self.turn_radps = 0.0
        self.is_blind = self.is_stuck = False
        self.frame_id = "odom"
        self.detected: list[tuple[float, float]] = []
        """What it detects [m; its frame]; published on `detections`."""
        self.commands = 0
        self.complaints: list[str] = []
        self.tokens: set[str] = set()
        self._kind = kind
        self._clock = clock
        self._is_rmw = kind.layout == "rmw_zenoh"
        self._domain = kind.domain
        self._number = 0
        self.numbers: dict[bytes, int] = {}
        """The number of the newest command of each publisher."""
        self._told_s = -math.inf
        self._unknown_s = 0.0
        """Since when commands have come from a publisher without tokens [s]; 0: from one with tokens."""
        self._lock = threading.Lock()
        self._session = session("client", f"tcp/127.0.0.1:{port}")
        self._zid = str(self._session.zid())
        self._gid = bytes.fromhex(self._zid.zfill(32))
        self._declared: list[Any] = []
        self._odom = self._session.declare_publisher(self._key("odom", kind.odometry_type))
        self._detections = self._session.declare_publisher(self._key("detections", POSE_ARRAY))
        if self._is_rmw:
            self._join_the_graph()
        self._declared.append(
            self._session.declare_subscriber(self._key("cmd_vel", kind.command_type), self._on_command)
        )

    def _join_the_graph(self) -> None:
        """Declare its tokens, and take all others'."""
        liveliness, everything = self._session.liveliness(), f"@ros2_lv/{self._domain}/**"
        own = [
            f"@ros2_lv/{self._domain}/{self._zid}/0/0/NN/%/{self._mangled}/driver",
            self._token("1", "MP", "odom", self._kind.odometry_type),
            self._token("2", "MS", "cmd_vel", self._kind.command_type),
        ]
        self._declared += [liveliness.declare_token(token) for token in own]
        self._declared.append(liveliness.declare_subscriber(everything, self._on_token, history=True))

    @property
    def _mangled(self) -> str:
        return self.name.replace("/", "%")

    def _key(self, topic: str, message_type: str) -> str:
        name = f"{self.name}/{topic}".removeprefix("/")
        if not self._is_rmw:
            return name
        return f"{self._domain}/{name}/{dds_name(message_type)}/{STORE.hash_rihs01(message_type)}"

    def _token(self, number: str, kind: str, topic: str, message_type: str) -> str:
        tail = f"{dds_name(message_type)}/{STORE.hash_rihs01(message_type)}/::,10:,:,:,,"
        name = f"{self._mangled}%{topic}"
        return f"@ros2_lv/{self._domain}/{self._zid}/0/{number}/{kind}/%/{self._mangled}/driver/{name}/{tail}"

    def close(self) -> None:
        """Leave."""
        self._session.close()

    # Commands

    def _on_token(self, sample: zenoh.Sample) -> None:
        change = self.tokens.add if sample.kind == zenoh.SampleKind.PUT else self.tokens.discard
        change(str(sample.key_expr))

    def _on_command(self, sample: zenoh.Sample) -> None:
        with self._lock:
            try:
                self._obey(sample)
            except Exception as error:
                self.complaints.append(f"{self.name}: {type(error).__name__}: {error}")

    def _obey(self, sample: zenoh.Sample) -> None:
        self._check_attachment(None if sample.attachment is None else sample.attachment.to_bytes())
        data = sample.payload.to_bytes()
        assert data[:4] == b"\0\1\0\0", data[:4]
        twist = bag_decoded(self._kind.command_type, data)
        assert data == bag_encoded(self._kind.command_type, twist), "bytes that are not the message's"
        if self._kind.command_type == TWIST_STAMPED:
            self._check_header(twist["header"])
            twist = twist["twist"]
        linear, angular = twist["linear"], twist["angular"]
        unused = (linear["z"], angular["x"], angular["y"])
        assert not any(unused), f"a robot moves on the ground and turns about z: {twist}"
        if not self._kind.is_holonomic:
            assert linear["x"] >= 0.0, f"told to drive backwards: {twist}"
            assert linear["y"] == 0.0, f"a differential drive moves only ahead: {twist}"
        assert math.hypot(linear["x"], linear["y"]) <= FASTEST_MPS + 1e-9, f"too fast: {twist}"
        assert abs(angular["z"]) <= FASTEST_RADPS + 1e-9, f"turns too fast: {twist}"
        self.commands += 1
        self.speed_mps, self.left_mps, self.turn_radps = linear["x"], linear["y"], angular["z"]
        self._told_s = time.monotonic()

    def _check_header(self, header: dict[str, Any]) -> None:
        assert header["frame_id"] == "base_link", header
        now, stamp = self._clock.stamp(), header["stamp"]
        assert 0 <= now["sec"] - stamp["sec"] <= 10, f"a stamp of another clock: {stamp} at {now}"

    def _check_attachment(self, attachment: bytes | None) -> None:
        if not self._is_rmw:
            assert attachment is None, "the bridge knows no attachment"
            return
        assert attachment is not None
        assert len(attachment) == 8 + 8 + 1 + 16, attachment.hex()
        number, time_ns, length = struct.unpack("<qqb", attachment[:17])
        gid = attachment[17:]
        assert length == 16
        assert any(gid)
        assert number > self.numbers.get(gid, 0), f"number {number} after {self.numbers.get(gid)}"
        self.numbers[gid] = number
        assert abs(time_ns / 1e9 - time.time()) < 60.0, time_ns
        self._unknown_s = 0.0 if self.knows_who_commands() else self._unknown_s or time.monotonic()
        assert not self._unknown_s or time.monotonic() - self._unknown_s < TOKENS_S, f"no tokens: {self.tokens}"

    def knows_who_commands(self) -> bool:
        """Whether a publisher of the commands has a token, and so has its node."""
        command_type = self._kind.command_type
        tail = f"{self._mangled}%cmd_vel/{dds_name(command_type)}/{STORE.hash_rihs01(command_type)}/::,10:,:,:,,"
        publishers = [token.split("/") for token in self.tokens if "/MP/" in token and token.endswith(tail)]
        nodes = ["/".join((*parts[:3], parts[3], parts[3], "NN", *parts[6:9])) for parts in publishers]
        return bool(nodes) and set(nodes) <= self.tokens

    # Motion

    def go(self, for_s: float) -> None:
        """Move, and publish where it is."""
        with self._lock:
            if time.monotonic() - self._told_s > TIMEOUT_S:
                self.speed_mps = self.left_mps = self.turn_radps = 0.0
            if not self.is_stuck:
                self.heading_rad += self.turn_radps * for_s
                sine, cosine = math.sin(self.heading_rad), math.cos(self.heading_rad)
                self.x_m += (self.speed_mps * cosine - self.left_mps * sine) * for_s
                self.y_m += (self.speed_mps * sine + self.left_mps * cosine) * for_s
        if not self.is_blind:
            message = self.odometry() if self._kind.odometry_type == ODOMETRY else self.pose_stamped()
            self._publish(self._odom, self._kind.odometry_type, message)
        if self.detected:
            poses = [self._pose(x_m, y_m, 0.0) for x_m, y_m in self.detected]
            self._publish(self._detections, POSE_ARRAY, {"header": self._header(), "poses": poses})

    def odometry(self) -> dict[str, Any]:
        """The message, with a position that is exact to 5 cm."""
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = 0.05**2
        zeros = {"x": 0.0, "y": 0.0, "z": 0.0}
        velocity = {"linear": zeros | {"x": self.speed_mps}, "angular": zeros | {"z": self.turn_radps}}
        return {
            "header": self._header(),
            "child_frame_id": "base_link",
            "pose": {"pose": self._pose(self.x_m, self.y_m, self.heading_rad), "covariance": covariance},
            "twist": {"twist": velocity, "covariance": [0.0] * 36},
        }

    def pose_stamped(self) -> dict[str, Any]:
        """The same without stamp and covariance, as of a node that only passes positions on."""
        pose = self._pose(self.x_m, self.y_m, self.heading_rad)
        return {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": self.frame_id}, "pose": pose}

    def _header(self) -> dict[str, Any]:
        return {"stamp": self._clock.stamp(), "frame_id": self.frame_id}

    @staticmethod
    def _pose(x_m: float, y_m: float, heading_rad: float) -> dict[str, Any]:
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(heading_rad / 2), "w": math.cos(heading_rad / 2)}
        return {"position": {"x": x_m, "y": y_m, "z": 0.0}, "orientation": turn}

    def _publish(self, publisher: zenoh.Publisher, message_type: str, message: dict[str, Any]) -> None:
        self._number += 1
        attachment = attached(self._number, self._gid) if self._is_rmw else None
        publisher.put(bag_encoded(message_type, message), attachment=attachment)


def attached(number: int, gid: bytes) -> bytes:
    """An attachment, as rmw_zenoh's document describes it."""
    return struct.pack("<qqb", number, time.time_ns(), 16) + gid


class Fleet:
    """Robots under way, in the order in which they were named."""

    def __init__(self, port: int, kind: Kind) -> None:
        self.robots: list[Robot] = []
        self.clock = Clock(kind.sim_time)
        self._port, self._kind = port, kind
        self._is_over = threading.Event()
        self._moving = threading.Lock()
        self._router = session("router", f"tcp/127.0.0.1:{port}")
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, name: str) -> Robot:
        """Another robot; it may have the name of one that is there."""
        robot = Robot(name, self._port, self._kind, self.clock)
        self.robots.append(robot)
        return robot

    def remove(self, robot: Robot) -> None:
        """Switch a robot off."""
        with self._moving:  # not while it publishes
            self.robots.remove(robot)
            robot.close()

    @contextmanager
    def commanding(self, name: str, node: str) -> Iterator[Callable[[float], None]]:
        """Another node that publishes a robot's commands, each a speed ahead [m/s], for Twists on rmw_zenoh's keys."""
        with session("client", f"tcp/127.0.0.1:{self._port}") as pilot:
            zid, topic, tail = str(pilot.zid()), f"{name}/cmd_vel", f"{dds_name(TWIST)}/{STORE.hash_rihs01(TWIST)}"
            publisher = pilot.declare_publisher(f"{self._kind.domain}{topic}/{tail}")
            head = f"@ros2_lv/{self._kind.domain}/{zid}/0"
            place = f"%/{name.replace('/', '%')}/{node}"
            tokens = (f"{head}/0/NN/{place}", f"{head}/1/MP/{place}/{topic.replace('/', '%')}/{tail}/::,10:,:,:,,")
            declared = [pilot.liveliness().declare_token(token) for token in tokens]
            assert len(declared) == len(tokens)
            numbers = count(1)

            def put(speed_mps: float) -> None:
                zeros = {"x": 0.0, "y": 0.0, "z": 0.0}
                data = bag_encoded(TWIST, {"linear": zeros | {"x": speed_mps}, "angular": zeros})
                publisher.put(data, attachment=attached(next(numbers), bytes.fromhex(zid.zfill(32))))

            yield put

    def complaints(self) -> list[str]:
        """What deviated from the documents."""
        return [complaint for robot in self.robots for complaint in robot.complaints]

    def _run(self) -> None:
        last_s, ticks = time.monotonic(), 0
        while not self._is_over.wait(PERIOD_S):
            now_s, ticks = time.monotonic(), ticks + 1
            self.clock.advance(now_s - last_s)
            if self._kind.sim_time:
                key = f"{self._kind.domain}/clock/{dds_name(CLOCK)}/{STORE.hash_rihs01(CLOCK)}"
                data = bag_encoded(CLOCK, {"clock": self.clock.stamp()})
                self._router.put(key, data, attachment=attached(ticks, bytes(15) + b"\1"))
            with self._moving:
                for robot in list(self.robots):
                    robot.go(0.0 if self.clock.is_paused else now_s - last_s)
            last_s = now_s

    def close(self) -> None:
        """End all robots, and their router."""
        self._is_over.set()
        self._thread.join()
        for robot in self.robots:
            robot.close()
        self._router.close()


@contextmanager
def fleet(port: int, *names: str, **kind: Any) -> Iterator[Fleet]:
    """Robots, of which none is left afterwards; fails if they have complained."""
    made = Fleet(port, Kind(**kind))
    try:
        for name in names:
            made.add(name)
        yield made
        complaints = made.complaints()
        assert not complaints, complaints
    finally:
        made.close()
