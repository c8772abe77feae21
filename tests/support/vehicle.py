"""A scripted MAVLink vehicle: `python -m tests.support.vehicle PORT [copter|rover|px4]` moves by set-points over UDP.

It speaks to 127.0.0.1:PORT and does what was seen of ArduPilot's own simulated copter and rover, and read of PX4's
source: it sends positions and its landed state only once asked; it follows velocity set-points in the mode for them,
and stands when they cease for half a second (the failsafe, as a user would set it); a copter's take-off ends at the
first set-point; a rover that is told no yaw turns to where the velocity points, and zero points north; a PX4 changes
to OFFBOARD only while set-points come. It is a point that takes its velocity at once.

Its positions (x north, y east) are printed at 20 Hz, a JSON line each: [time s, north m, east m, velocity north,
velocity east, set-points so far, heading rad]. A word on standard input changes it: `disarm`, `arm`, `blind` (no
positions), `see`, `loiter`, `guided`, `land`, `takeoff`, `reboot`, `noise` (no MAVLink); its end ends it.
"""

import json
import math
import os
import sys
import threading
import time
from typing import Any

os.environ.setdefault("MAVLINK20", "1")
from pymavlink import mavutil

STEP_S = 0.05
FAILSAFE_S = 0.5
TAKE_OFF_S = 0.6
MASKS = {0b110111000111: False, 0b010111000111: True}
"""Velocity alone, and whether a yaw rate (of zero) comes with it."""
MODES = {
    "copter": {"guided": 4, "loiter": 5},
    "rover": {"guided": 15, "loiter": 5},
    "px4": {"guided": 6 << 16, "loiter": 4 << 16 | 3 << 24},
}
"""The autopilots' own numbers; PX4's mode for set-points is OFFBOARD."""

mavlink = mavutil.mavlink
TYPES = {
    "copter": (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
    "rover": (mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
    "px4": (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4),
}


class Vehicle:
    """Where it is, and what it was last told."""

    def __init__(self, kind: str = "copter") -> None:
        self.kind = kind
        self.at = [0.0, 0.0]
        self.heading_rad = 1.0
        self.set_points = 0
        self.is_armed, self.sees, self.mode = True, True, MODES[kind]["guided"]
        self.state = mavlink.MAV_LANDED_STATE_UNDEFINED if kind == "rover" else mavlink.MAV_LANDED_STATE_IN_AIR
        self.boot(0.0)

    def boot(self, now_s: float) -> None:
        """Forget who asked for what."""
        self.booted_s = now_s
        self.velocity = (0.0, 0.0)
        self.told_s = -math.inf
        self.lifted_s = math.inf
        self.asked: set[int] = set()

    def hear(self, message: Any, now_s: float) -> None:
        """Requests for messages, and velocity set-points in the local frame."""
        kind = message.get_type()
        if kind == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            self.asked.add(int(message.param1))
        if kind != "SET_POSITION_TARGET_LOCAL_NED" or message.type_mask not in MASKS:
            return
        assert message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
        self.set_points += 1
        self.told_s = now_s
        if self.state == mavlink.MAV_LANDED_STATE_TAKEOFF and self.kind == "copter":
            self.state, self.lifted_s = mavlink.MAV_LANDED_STATE_ON_GROUND, math.inf
        grounded = (mavlink.MAV_LANDED_STATE_ON_GROUND, mavlink.MAV_LANDED_STATE_TAKEOFF)
        if self.is_armed and self.mode == MODES[self.kind]["guided"] and self.state not in grounded:
            self.velocity = (message.vx, message.vy)
            if self.kind == "rover" and not MASKS[message.type_mask]:
                self.heading_rad = math.atan2(message.vy, message.vx)

    def go(self, now_s: float, for_s: float) -> None:
        """Move, or stand when nothing was heard; rise."""
        if now_s - self.told_s > FAILSAFE_S:
            self.velocity = (0.0, 0.0)
        self.at = [at + rate * for_s for at, rate in zip(self.at, self.velocity, strict=True)]
        if now_s - self.lifted_s > TAKE_OFF_S:
            self.state, self.lifted_s = mavlink.MAV_LANDED_STATE_IN_AIR, math.inf

    def obey(self, word: str, now_s: float) -> None:
        """What a test, or a pilot, wants to happen."""
        if word in ("arm", "disarm"):
            self.is_armed = word == "arm"
        elif word in ("see", "blind"):
            self.sees = word == "see"
        elif word == "land":
            self.state, self.velocity = mavlink.MAV_LANDED_STATE_ON_GROUND, (0.0, 0.0)
        elif word == "takeoff":
            self.state, self.lifted_s = mavlink.MAV_LANDED_STATE_TAKEOFF, now_s
        elif word == "reboot":
            self.boot(now_s)
        elif word == "loiter" or self.kind != "px4" or now_s - self.told_s < FAILSAFE_S:
            self.mode = MODES[self.kind][word]


def main(port: int, kind: str = "copter") -> None:
    """Go about until standard input ends."""
    link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1, source_component=1, dialect="common")
    vehicle = Vehicle(kind)
    is_over = threading.Event()

    def listen() -> None:
        for line in sys.stdin:
            if line.strip() == "noise":
                link.write(b"\xfd\xff nonsense \xfe\xfd" * 20)
            else:
                vehicle.obey(line.strip(), time.monotonic())
        is_over.set()

    threading.Thread(target=listen, daemon=True).start()
    last_s = beat_s = time.monotonic()
    vehicle.boot(last_s - 10.0)
    while not is_over.wait(STEP_S):
        now_s = time.monotonic()
        try:
            while (message := link.recv_match()) is not None:
                vehicle.hear(message, now_s)
            vehicle.go(now_s, now_s - last_s)
            last_s = now_s
            if now_s >= beat_s:
                beat_s = now_s + 0.5
                armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if vehicle.is_armed else 0
                mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed
                link.mav.heartbeat_send(*TYPES[kind], mode, vehicle.mode, mavlink.MAV_STATE_ACTIVE)
            if vehicle.sees and mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED in vehicle.asked:
                boot_ms = int(1000 * (now_s - vehicle.booted_s))
                link.mav.local_position_ned_send(boot_ms, *vehicle.at, -10.0, *vehicle.velocity, 0.0)
            if mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE in vehicle.asked:
                link.mav.extended_sys_state_send(mavlink.MAV_VTOL_STATE_UNDEFINED, vehicle.state)
        except OSError:
            continue  # nobody listens there yet
        row = [now_s, *vehicle.at, *vehicle.velocity, vehicle.set_points, vehicle.heading_rad]
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
