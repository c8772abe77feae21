"""A scripted MAVLink vehicle: `python -m tests.vehicle PORT` flies by the set-points that it gets over UDP.

It speaks to 127.0.0.1:PORT. It is a point that follows its velocity set-point at once, and it has the failsafe of a
real autopilot: without a set-point for half a second it stands. Its positions (x north, y east) go out at 20 Hz and
are printed, a JSON line each: [time s, north m, east m, velocity north, velocity east, set-points so far]. A word on
standard input changes it: `disarm`, `arm`, `blind` (no positions), `see`, `loiter`, `guided`; its end ends the vehicle.
"""

import json
import os
import sys
import threading
import time
from typing import Any

os.environ.setdefault("MAVLINK20", "1")
from pymavlink import mavutil

STEP_S = 0.05
FAILSAFE_S = 0.5
GUIDED, LOITER = 4, 5
"""ArduCopter's numbers of its flight modes."""


class Vehicle:
    """Where it is, and what it was last told."""

    def __init__(self, north_m: float = 0.0, east_m: float = 0.0) -> None:
        self.at = [north_m, east_m]
        self.velocity = (0.0, 0.0)
        self.told_s = 0.0
        self.set_points = 0
        self.is_armed, self.sees, self.mode = True, True, GUIDED

    def hear(self, message: Any, now_s: float) -> None:
        """Velocity set-points in the local frame are followed."""
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED" and message.type_mask == 0b110111000111:
            assert message.coordinate_frame == mavutil.mavlink.MAV_FRAME_LOCAL_NED
            self.velocity, self.told_s = (message.vx, message.vy), now_s
            self.set_points += 1

    def fly(self, now_s: float, for_s: float) -> None:
        """Move, or stand when nothing was heard."""
        if now_s - self.told_s > FAILSAFE_S:
            self.velocity = (0.0, 0.0)
        self.at = [at + rate * for_s for at, rate in zip(self.at, self.velocity, strict=True)]

    def obey(self, word: str) -> None:
        """What a test wants to happen."""
        if word in ("arm", "disarm"):
            self.is_armed = word == "arm"
        elif word in ("see", "blind"):
            self.sees = word == "see"
        else:
            self.mode = {"guided": GUIDED, "loiter": LOITER}[word]


def main(port: int) -> None:
    """Fly until standard input ends."""
    link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1, dialect="common")
    mavlink = mavutil.mavlink
    vehicle = Vehicle()
    is_over = threading.Event()

    def listen() -> None:
        for line in sys.stdin:
            vehicle.obey(line.strip())
        is_over.set()

    threading.Thread(target=listen, daemon=True).start()
    began_s = beat_s = last_s = time.monotonic()
    while not is_over.wait(STEP_S):
        now_s = time.monotonic()
        try:
            while (message := link.recv_match()) is not None:
                vehicle.hear(message, now_s)
            vehicle.fly(now_s, now_s - last_s)
            last_s = now_s
            if now_s >= beat_s:
                beat_s = now_s + 0.5
                armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if vehicle.is_armed else 0
                mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed
                kind = (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
                link.mav.heartbeat_send(*kind, mode, vehicle.mode, mavlink.MAV_STATE_ACTIVE)
            if vehicle.sees:
                boot_ms = int(1000 * (now_s - began_s))
                link.mav.local_position_ned_send(boot_ms, *vehicle.at, -10.0, *vehicle.velocity, 0.0)
        except OSError:
            continue  # nobody listens there yet
        print(json.dumps([now_s, *vehicle.at, *vehicle.velocity, vehicle.set_points]), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
