"""A body that is a ROS 2 robot: odometry in, Twist out, over Zenoh and without ROS (docs/ROS2.md has every byte).

A separate thread sends commands `rate_hz` times a second and stops the robot when the agent stalls or its odometry
ceases. If the whole process dies, commands cease and the robot's own time-out must act, such as `cmd_vel_timeout` of
ros2_control's diff_drive_controller (0.5 s).
"""

import logging
import math
import time
from collections.abc import Mapping
from typing import Any, ClassVar

from deltaswarm_agent.body import BodyContext, Sensed
from deltaswarm_board.bodies.guarded import GuardedBody
from deltaswarm_ros2.definitions import CLOCK, POSE_ARRAY, TWIST_STAMPED
from deltaswarm_ros2.detections import Detections
from deltaswarm_ros2.keys import full_name
from deltaswarm_ros2.link import Hear, Ros2Link, Topic
from deltaswarm_ros2.motion import STOP, Drive, ExpectedOdometry, Odometry, PlanarFrame, Pose, Twist, beside
from deltaswarm_ros2.settings import HOLONOMIC, Ros2Settings
from deltaswarm_wire.messages import MAX_SENSED

log = logging.getLogger("deltaswarm.ros2")

RETRY_S = 1.0
NO_CLOCK = "no /clock, from which the robot's time is taken (use_sim_time)"


class Ros2Body(GuardedBody):
    """One robot, which may appear later and disappear; meanwhile the body has a fault."""

    Settings: ClassVar[type[Any]] = Ros2Settings
    REAL_TIME: ClassVar[bool] = True
    CLOSE_S: ClassVar[float] = 1.5

    def __init__(self, options: Ros2Settings, context: BodyContext) -> None:
        super().__init__(options, context)
        self._options = options
        agent = context.settings
        namespace = options.namespace_of(context.agent)
        frame = PlanarFrame(options.origin_x_m, options.origin_y_m, options.turn_deg)
        self._frame = frame
        self._topic = Topic(full_name(options.odometry, namespace), options.odometry_type)
        self._odometry = Odometry(
            ExpectedOdometry(
                *(self._topic.name, options.frame, frame, options.position_s, options.fixed_frame),
                options.max_speed_mps,
            )
        )
        self._drive = Drive(options.drive == HOLONOMIC, options.turn_gain, options.max_turn_radps)
        cell_m = options.detections_cell_m if options.detections else math.inf  # there are none
        self._detections = Detections(
            agent.width_m, agent.height_m, cell_m, agent.sensing_range_m, options.detections_s
        )
        self._clock: tuple[Mapping[str, int], float] | None = None
        """The robot's time by /clock, and when it was heard [s]."""
        self._commanders: list[str] = []
        """Other nodes that publish commands, to which the robot is left."""
        heard: dict[Topic, Hear] = {self._topic: self._hear_odometry}
        if options.detections:
            heard[Topic(full_name(options.detections, namespace), POSE_ARRAY)] = self._hear_detections
        if options.use_sim_time:
            heard[Topic("/clock", CLOCK)] = self._hear_clock
        self._command_topic = Topic(full_name(options.command, namespace), options.command_type)
        self._link = Ros2Link(options, context.agent, self._command_topic, heard)
        self._thread.start()

    # The agent's thread

    def sense(self, time_s: float) -> Sensed:
        now_s = time.monotonic()
        sensed = super().sense(time_s)
        with self._lock:
            reason = self._reason_to_stand(now_s)
            detected = self._detections.events(now_s)
        if not sensed.fault:
            return sensed._replace(events=(sensed.events + detected)[:MAX_SENSED])
        if self._no_link:
            return sensed
        return sensed._replace(fault="; ".join([reason or sensed.fault, *self._link.mismatches(self._topic)]))

    # The robot's thread

    def _serve(self) -> None:
        """Send commands at `rate_hz`; retry the link without end."""
        while not self._closing.is_set():
            try:
                self._link.open()
                self._no_link = "" if self._link.is_linked else self._unlinked
                self._command()
                self._closing.wait(1.0 / self._options.rate_hz)
            except OSError as error:
                self._no_link = f"{self._unlinked}: {error}"
                self._link.close()
                self._closing.wait(RETRY_S)
        try:
            if not self._commanders:
                self._send(STOP)
        except OSError as error:
            log.warning("the robot may not have been stopped: %s", error)
        self._link.close()

    @property
    def _unlinked(self) -> str:
        return f"no link to {', '.join((*self._options.connect, *self._options.listen))}"

    def _command(self) -> None:
        now_s = time.monotonic()
        before, self._commanders = self._commanders, [] if self._options.shared else self._link.commanders()
        with self._lock:
            pose = self._odometry.pose
            self._guard.inhibit(self._reason_to_stand(now_s))
        velocity = self._next_velocity(now_s)
        if self._commanders:
            if not before:
                self._send(STOP)  # the last command, so that the robot stands until the other one comes
        elif pose is not None:
            self._send(self._within_fence(self._drive.twist(velocity, pose.heading_rad), pose.heading_rad))

    def _within_fence(self, twist: Twist, heading_rad: float) -> Twist:
        """Let a differential robot only turn while it faces the fence, which the wanted velocity may keep clear of."""
        if self._drive.is_holonomic:
            return twist
        faced = (twist.forward_mps * math.cos(heading_rad), twist.forward_mps * math.sin(heading_rad))
        with self._lock:
            return twist if self._guard.permits(faced) else twist._replace(forward_mps=0.0)

    def _send(self, twist: Twist) -> None:
        message: dict[str, Any] = {
            "linear": {"x": twist.forward_mps, "y": twist.left_mps},
            "angular": {"z": twist.turn_radps},
        }
        if self._options.command_type == TWIST_STAMPED:
            message = {"header": {"stamp": self._stamp(), "frame_id": self._options.base_frame}, "twist": message}
        self._link.send(message)

    def _stamp(self) -> Mapping[str, int]:
        if self._options.use_sim_time:
            return self._clock[0] if self._clock else {}
        sec, nanosec = divmod(time.time_ns(), 1_000_000_000)
        return {"sec": sec, "nanosec": nanosec}

    def _reason_to_stand(self, now_s: float) -> str:
        is_timed = self._clock is not None and now_s - self._clock[1] <= self._options.position_s
        if self._options.use_sim_time and not is_timed:
            return NO_CLOCK
        if self._commanders:
            return f"{self._command_topic.name} is also published by {', '.join(self._commanders)}"
        return self._odometry.reason_to_stand(now_s)

    # Zenoh's thread

    def _hear_odometry(self, message: Mapping[str, Any], gid: bytes) -> None:
        now_s = time.monotonic()
        with self._lock:
            if not self._odometry.take(message, gid, now_s) or self._odometry.pose is None:
                return
            self._guard.locate(self._odometry.pose.x_m, self._odometry.pose.y_m, now_s)
            if self._odometry.std_m is not None:
                self._guard.set_uncertainty(self._odometry.std_m)

    def _hear_clock(self, message: Mapping[str, Any], gid: bytes) -> None:
        before = self._clock
        if before is None or before[0] != message["clock"]:  # a paused simulator may repeat its time
            self._clock = (message["clock"], time.monotonic())

    def _hear_detections(self, message: Mapping[str, Any], gid: bytes) -> None:
        options, frame_id, now_s = self._options, message["header"]["frame_id"], time.monotonic()
        at = [(pose["position"]["x"], pose["position"]["y"]) for pose in message["poses"]]
        with self._lock:
            robot = self._odometry.pose
            if robot is None:
                return
            if frame_id == options.base_frame:
                places = [beside(robot, *place) for place in at]
            elif options.frame in ("", frame_id):
                places = [self._frame.to_arena(Pose(*place, 0.0))[:2] for place in at]
            else:
                raise ValueError(f"frame_id must be {options.base_frame} or {options.frame} (got {frame_id!r})")
            self._detections.take(places, (robot.x_m, robot.y_m), now_s)
