"""Stand-in ROS 2 robots, written from the documents of ROS 2, rmw_zenoh and zenoh-plugin-ros2dds alone.

`fleet(port, "/robot1", ...)` is a Zenoh router and, each with a session of its own, robots with a differential drive
that publish `odom` at 20 Hz and follow `cmd_vel`. They share no code with deltaswarm: keys and tokens are written out
here, messages are rosbags'. What deviates from the documents is in `Robot.complaints`: a key, a token, an attachment,
a byte of a message, a motion that such a robot cannot do.

The documents: rmw_zenoh's docs/design.md (keys, liveliness tokens, attachments), the plugin's README.md (keys),
nav_msgs/Odometry, geometry_msgs/Twist and REP 103 (frames and units).
"""

import json
import math
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from deltaswarm_wire.session import use_one_worker_thread
from tests.support.ros2_types import STORE, bag_decoded, bag_encoded

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

PERIOD_S = 0.05
TIMEOUT_S = 0.5
"""Time without a command after which a robot stands, as diff_drive_controller does [s]."""

FASTEST_MPS, FASTEST_RADPS = 2.0, 1.5

ODOMETRY, TWIST, POSE_ARRAY = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist", "geometry_msgs/msg/PoseArray"


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

    def __init__(self, name: str, port: int, layout: str, domain: int) -> None:
        self.name = name
        self.x_m, self.y_m, self.heading_rad = 0.0, 0.0, 0.0
        self.speed_mps = self.turn_radps = 0.0
        self.is_blind = self.is_stuck = False
        self.frame_id = "odom"
        self.detected: list[tuple[float, float]] = []
        """What it detects [m; its frame]; published on `detections`."""
        self.commands = 0
        self.complaints: list[str] = []
        self.tokens: set[str] = set()
        self._is_rmw = layout == "rmw_zenoh"
        self._domain = domain
        self._number = 0
        self._gids: dict[bytes, int] = {}
        self._told_s = -math.inf
        self._lock = threading.Lock()
        self._session = session("client", f"tcp/127.0.0.1:{port}")
        self._zid = str(self._session.zid())
        self._gid = bytes.fromhex(self._zid.zfill(32))
        self._declared: list[Any] = []
        self._odom = self._session.declare_publisher(self._key("odom", ODOMETRY))
        self._detections = self._session.declare_publisher(self._key("detections", POSE_ARRAY))
        if self._is_rmw:
            self._join_the_graph()
        self._declared.append(self._session.declare_subscriber(self._key("cmd_vel", TWIST), self._on_command))

    def _join_the_graph(self) -> None:
        """Declare its tokens, and take those that are there before the first command comes."""
        liveliness, everything = self._session.liveliness(), f"@ros2_lv/{self._domain}/**"
        own = [
            f"@ros2_lv/{self._domain}/{self._zid}/0/0/NN/%/{self._mangled}/driver",
            self._token("1", "MP", "odom", ODOMETRY),
            self._token("2", "MS", "cmd_vel", TWIST),
        ]
        self._declared += [liveliness.declare_token(token) for token in own]
        self._declared.append(liveliness.declare_subscriber(everything, self._on_token))
        for reply in liveliness.get(everything):
            if reply.ok is not None:
                self.tokens.add(str(reply.ok.key_expr))

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
        twist = bag_decoded(TWIST, data)
        assert data == bag_encoded(TWIST, twist), "bytes that are not the message's"
        linear, angular = twist["linear"], twist["angular"]
        unused = (linear["y"], linear["z"], angular["x"], angular["y"])
        assert not any(unused), f"a differential drive moves only ahead and turns only about z: {twist}"
        assert 0.0 <= linear["x"] <= FASTEST_MPS + 1e-9, f"too fast: {twist}"
        assert abs(angular["z"]) <= FASTEST_RADPS + 1e-9, f"turns too fast: {twist}"
        self.commands += 1
        self.speed_mps, self.turn_radps = linear["x"], angular["z"]
        self._told_s = time.monotonic()

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
        assert number == self._gids.get(gid, number - 1) + 1 > 0, f"number {number} after {self._gids.get(gid)}"
        self._gids[gid] = number
        assert abs(time_ns / 1e9 - time.time()) < 60.0, time_ns
        tail = f"{self._mangled}%cmd_vel/{dds_name(TWIST)}/{STORE.hash_rihs01(TWIST)}/::,10:,:,:,,"
        publishers = [token.split("/") for token in self.tokens if "/MP/" in token and token.endswith(tail)]
        assert publishers, f"no token of a publisher of cmd_vel in {self.tokens}"
        for parts in publishers:
            node = "/".join((*parts[:3], parts[3], parts[3], "NN", *parts[6:9]))
            assert node in self.tokens, f"no token of its node: {node}"

    # Motion

    def go(self, for_s: float) -> None:
        """Move, and publish where it is."""
        with self._lock:
            if time.monotonic() - self._told_s > TIMEOUT_S:
                self.speed_mps = self.turn_radps = 0.0
            if not self.is_stuck:
                self.heading_rad += self.turn_radps * for_s
                self.x_m += self.speed_mps * math.cos(self.heading_rad) * for_s
                self.y_m += self.speed_mps * math.sin(self.heading_rad) * for_s
        if not self.is_blind:
            self._publish(self._odom, ODOMETRY, self.odometry())
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

    def _header(self) -> dict[str, Any]:
        sec, nanosec = divmod(time.time_ns(), 1_000_000_000)
        return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": self.frame_id}

    @staticmethod
    def _pose(x_m: float, y_m: float, heading_rad: float) -> dict[str, Any]:
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(heading_rad / 2), "w": math.cos(heading_rad / 2)}
        return {"position": {"x": x_m, "y": y_m, "z": 0.0}, "orientation": turn}

    def _publish(self, publisher: zenoh.Publisher, message_type: str, message: dict[str, Any]) -> None:
        self._number += 1
        attachment = struct.pack("<qqb", self._number, time.time_ns(), 16) + self._gid if self._is_rmw else None
        publisher.put(bag_encoded(message_type, message), attachment=attachment)


class Fleet:
    """Robots under way, in the order in which they were named."""

    def __init__(self, port: int, layout: str, domain: int) -> None:
        self.robots: list[Robot] = []
        self._made = (port, layout, domain)
        self._is_over = threading.Event()
        self._router = session("router", f"tcp/127.0.0.1:{port}")
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, name: str) -> Robot:
        """Another robot; it may have the name of one that is there."""
        robot = Robot(name, *self._made)
        self.robots.append(robot)
        return robot

    def remove(self, robot: Robot) -> None:
        """Switch a robot off."""
        self.robots.remove(robot)
        robot.close()

    def complaints(self) -> list[str]:
        """What deviated from the documents."""
        return [complaint for robot in self.robots for complaint in robot.complaints]

    def _run(self) -> None:
        last_s = time.monotonic()
        while not self._is_over.wait(PERIOD_S):
            now_s = time.monotonic()
            for robot in list(self.robots):
                robot.go(now_s - last_s)
            last_s = now_s

    def close(self) -> None:
        """End all robots, and their router."""
        self._is_over.set()
        self._thread.join()
        for robot in self.robots:
            robot.close()
        self._router.close()


@contextmanager
def fleet(port: int, *names: str, layout: str = "rmw_zenoh", domain: int = 0) -> Iterator[Fleet]:
    """Robots, of which none is left afterwards; fails if they have complained."""
    made = Fleet(port, layout, domain)
    try:
        for name in names:
            made.add(name)
        yield made
        complaints = made.complaints()
        assert not complaints, complaints
    finally:
        made.close()
