"""A robot that is a node of another implementation: `python -m tests.peers.robot NODE PORT NAMESPACE [best_effort]`.

It publishes `odom` at 20 Hz and follows `cmd_vel`, as a unicycle that stands half a second after its last command. A
row of its track is printed each time: [time s, x m, y m, speed m/s, commands]. A line on standard input changes it:
`blind` (no odometry), `see`, `clock SECONDS` (its clock is put forward), `teleop` (it publishes commands, too); its end
ends it.
"""

import json
import math
import os
import sys
import threading
import time
from typing import Any

from tests.peers.nodes import made

PERIOD_S, TIMEOUT_S = 0.05, 0.5
ODOMETRY, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"


class Robot:
    """Its place and heading [m, rad] are its odometry."""

    def __init__(self) -> None:
        self.x_m = self.y_m = self.heading_rad = self.speed_mps = self.turn_radps = 0.0
        self.sees, self.clock_s, self.commands, self.told_s = True, 0.0, 0, -math.inf

    def hear(self, twist: Any) -> None:
        self.speed_mps, self.turn_radps = float(twist.linear.x), float(twist.angular.z)
        self.commands, self.told_s = self.commands + 1, time.monotonic()

    def go(self, for_s: float) -> None:
        if time.monotonic() - self.told_s > TIMEOUT_S:
            self.speed_mps = self.turn_radps = 0.0
        self.heading_rad += self.turn_radps * for_s
        self.x_m += self.speed_mps * math.cos(self.heading_rad) * for_s
        self.y_m += self.speed_mps * math.sin(self.heading_rad) * for_s

    def obey(self, word: str, *values: str) -> None:
        if word == "clock":
            self.clock_s += float(values[0])
        else:
            self.sees = word == "see"

    def odometry(self) -> dict[str, Any]:
        """The message, exact to 5 cm."""
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = 0.05**2
        sec, nanosec = divmod(time.time_ns() + round(1e9 * self.clock_s), 1_000_000_000)
        zeros = {"x": 0.0, "y": 0.0, "z": 0.0}
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(self.heading_rad / 2), "w": math.cos(self.heading_rad / 2)}
        pose = {"position": {"x": self.x_m, "y": self.y_m, "z": 0.0}, "orientation": turn}
        velocity = {"linear": zeros | {"x": self.speed_mps}, "angular": zeros | {"z": self.turn_radps}}
        return {
            "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "odom"},
            "child_frame_id": "base_link",
            "pose": {"pose": pose, "covariance": covariance},
            "twist": {"twist": velocity, "covariance": [0.0] * 36},
        }


def main(kind: str, port: str, namespace: str, reliability: str = "reliable") -> None:
    """Go about until standard input ends."""
    robot, node = Robot(), made(kind, int(port), "driver", namespace)
    publish = node.advertise(ODOMETRY, "odom", reliability)
    node.subscribe(TWIST, "cmd_vel", robot.hear)
    heard: list[str] = []
    others: list[Any] = []

    def listen() -> None:
        heard.extend(iter(sys.stdin.readline, ""))
        heard.append("")

    threading.Thread(target=listen, daemon=True).start()
    last_s = time.monotonic()
    while "" not in heard:
        while heard:
            word, *values = heard.pop(0).split()
            if word == "teleop":
                others.append(node.advertise(TWIST, "cmd_vel"))
            else:
                robot.obey(word, *values)
        node.spin(PERIOD_S)
        now_s = time.monotonic()
        robot.go(now_s - last_s)
        last_s = now_s
        if robot.sees:
            publish(robot.odometry())
        print(json.dumps([now_s, robot.x_m, robot.y_m, robot.speed_mps, robot.commands]), flush=True)
    os._exit(0)  # the others' threads may not end


if __name__ == "__main__":
    main(*sys.argv[1:])
