"""Settings of a ROS 2 robot (`body.py`): its topics, its link, its frame, its limits."""

import math
from dataclasses import dataclass, replace
from typing import Any

from deltaswarm_board.bodies.guard import GuardLimits
from deltaswarm_board.bodies.guarded import GuardedSettings
from deltaswarm_ros2.definitions import ODOMETRY, POSE_STAMPED, TWIST, TWIST_STAMPED
from deltaswarm_ros2.keys import LAYOUTS, MAX_DOMAIN, NAME_RULE, RMW_ZENOH, is_name
from deltaswarm_wire.checked import Problem, key
from deltaswarm_wire.session import link_problems

PEER, CLIENT = "peer", "client"
DIFFERENTIAL, HOLONOMIC = "differential", "holonomic"

TURNING = 1.5
"""Time that a differential robot has to turn before it must follow, by that of half a turn at full rate."""


@dataclass(frozen=True)
class Ros2Settings(GuardedSettings):
    """The robot, its frame, and its limits."""

    layout: str = key(RMW_ZENOH, "the keys' format: of ROS 2 on rmw_zenoh, or of zenoh-bridge-ros2dds", choices=LAYOUTS)
    connect: tuple[str, ...] = key(("tcp/127.0.0.1:7447",), "the robot's Zenoh router or bridge; retried without end")
    listen: tuple[str, ...] = key((), "peer: endpoints to listen on")
    mode: str = key(CLIENT, "a client of the router or bridge, or a peer", choices=(CLIENT, PEER))
    zenoh: dict[str, Any] = key(dict, "any other Zenoh setting, by its path: its value as JSON5 text")
    domain: int = key(0, "ROS_DOMAIN_ID; rmw_zenoh only", low=0, high=MAX_DOMAIN)
    namespace: str = key("/robot{id}", "the robot's namespace; {id} is the agent's number; empty: none")
    odometry: str = key("odom", "topic of its position; relative to the namespace unless it begins with /")
    odometry_type: str = key(ODOMETRY, "type of this topic", choices=(ODOMETRY, POSE_STAMPED))
    command: str = key("cmd_vel", "topic of its commands")
    command_type: str = key(TWIST, "type of this topic", choices=(TWIST, TWIST_STAMPED))
    shared: bool = key(False, "other nodes may publish commands, too; else the agent sends none while one is there")
    detections: str = key("", "topic of detected events, a geometry_msgs/msg/PoseArray; empty: none")
    detections_s: float = key(1.0, "time for which a detection is an event [s]", above=0, high=60)
    detections_cell_m: float = key(1.0, "events closer than this may be one [m]", low=0.01, high=1000)
    frame: str = key("odom", "frame_id of the positions; empty: any")
    base_frame: str = key("base_link", "frame_id of the robot itself, of stamped commands and its own detections")
    fixed_frame: bool = key(False, "the frame survives a restart of the odometry: a map, or motion capture")
    origin_x_m: float = key(0.0, "the arena's corner (0, 0), along x of the frame [m]")
    origin_y_m: float = key(0.0, "the arena's corner (0, 0), along y of the frame [m]")
    turn_deg: float = key(
        0.0, "direction of the arena's +x in the frame, counter-clockwise from its +x", low=-360, high=360
    )
    drive: str = key(DIFFERENTIAL, "how the robot moves", choices=(DIFFERENTIAL, HOLONOMIC))
    turn_gain: float = key(2.0, "differential: turn per angle to the wanted direction [1/s]", above=0, high=20)
    max_turn_radps: float = key(1.5, "differential: fastest turn [rad/s]", above=0, high=20)
    use_sim_time: bool = key(False, "take the time from /clock, as nodes with use_sim_time do")

    def problems(self) -> list[Problem]:
        """Check what involves several keys, and names."""
        problems = super().problems()
        for name in ("odometry", "command", "detections"):
            topic = getattr(self, name)
            if not (is_name(topic) or (name == "detections" and not topic)):
                problems.append(Problem(name, repr(topic), NAME_RULE))
        namespace = self.namespace_of(0)
        if namespace and not (namespace.startswith("/") and is_name(namespace)):
            problems.append(Problem("namespace", repr(self.namespace), f"must begin with / and {NAME_RULE[5:]}"))
        if self.detections and self.events:
            problems.append(Problem("events", repr(self.events), "must be left out with detections"))
        problems += link_problems(self.connect, self.listen, self.zenoh)
        if self.mode == CLIENT and (self.listen or not self.connect):
            problems.append(Problem("mode", repr(self.mode), "must be peer to listen or without connect"))
        return problems

    def limits(self, step_s: float) -> GuardLimits:
        """Make the guard's limits; a differential robot has time to turn, during which it may stand."""
        limits = super().limits(step_s)
        turning_s = 0.0 if self.drive == HOLONOMIC else TURNING * math.pi / self.max_turn_radps
        return replace(limits, follow_s=limits.follow_s + turning_s)

    def namespace_of(self, agent: int) -> str:
        """Return the namespace of an agent's robot."""
        return self.namespace.replace("{id}", str(agent))
