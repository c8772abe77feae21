"""A copter by MAVSDK's servers, and a person's ground station by its client.

`python -m tests.peers.mavsdk_vehicle PORT`: MAVSDK takes commands, receives set-points, sends telemetry and heartbeats
(of a generic autopilot with PX4's modes). The copter itself is a point that takes its velocity at once if it is armed,
in OFFBOARD and in the air, and stands half a second after its last set-point. It prints the rows of
`tests/support/vehicle.py`. A word is what the person does by the ground station: `arm`, `disarm`, `manual`, `offboard`;
or what happens: `unarmable`, `land`, `fly`, `lose` (the link), `link`. What the person is refused goes to stderr.
"""

import json
import math
import os
import sys
import threading
import time
from typing import Any

from mavsdk import ComponentType
from mavsdk.exceptions import MavsdkError
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action import action
from mavsdk.plugins.action_server import action_server
from mavsdk.plugins.mavlink_direct import mavlink_direct
from mavsdk.plugins.mavlink_direct_server import mavlink_direct_server
from mavsdk.plugins.telemetry_server import telemetry_server as telemetry

from tests.support.fields import free_port

STEP_S, FAILSAFE_S = 0.05, 0.5
OFFBOARD = 6
MODES = {"manual": 1, "offboard": OFFBOARD}
"""PX4's main modes."""


class Vehicle:
    """Where it is, what it was last told, and MAVSDK's servers."""

    def __init__(self, port: int, own_port: int) -> None:
        self.at, self.velocity = [0.0, 0.0], (0.0, 0.0)
        self.set_points, self.told_s = 0, -math.inf
        self.is_armed, self.main_mode, self.landed = True, OFFBOARD, telemetry.LandedState.IN_AIR
        self._mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
        self._board = f"udpout://127.0.0.1:{port}"
        self._link: Any = self._mavsdk.add_any_connection_with_handle(self._board)
        self._mavsdk.add_any_connection(f"udpin://127.0.0.1:{own_port}")
        component = self._mavsdk.server_component()
        self.actions = action_server.ActionServer(component)
        self.actions.set_allowable_flight_modes(action_server.AllowableFlightModes(False, True, True))
        self.actions.set_armable(True, True)
        self.actions.set_disarmable(True, True)
        self.actions.set_armed_state(True)
        self.actions.set_flight_mode(action_server.FlightMode.OFFBOARD)
        self.actions.subscribe_arm_disarm(self._hear_arming)
        self.actions.subscribe_flight_mode_change(self._hear_mode)
        self._telemetry = telemetry.TelemetryServer(component)
        self._direct = mavlink_direct_server.MavlinkDirectServer(component)
        self._direct.subscribe_message("SET_POSITION_TARGET_LOCAL_NED", self._hear_set_point)

    def _hear_arming(self, result: Any, asked: Any, _: Any) -> None:
        if result == action_server.ActionServerResult.SUCCESS:
            self.is_armed = bool(asked.arm)

    def _hear_mode(self, result: Any, mode: Any, _: Any) -> None:
        self.main_mode = MODES[action_server.FlightMode(mode).name.lower()]

    def _hear_set_point(self, message: Any, _: Any) -> None:
        fields = json.loads(message.fields_json)
        self.set_points, self.told_s = self.set_points + 1, time.monotonic()
        obeys = self.is_armed and self.main_mode == OFFBOARD and self.landed == telemetry.LandedState.IN_AIR
        self.velocity = (fields["vx"], fields["vy"]) if obeys else (0.0, 0.0)

    def happen(self, word: str) -> None:
        if word in ("lose", "link"):
            if self._link is not None:
                self._mavsdk.remove_connection(self._link)
            self._link = self._mavsdk.add_any_connection_with_handle(self._board) if word == "link" else None
        elif word == "unarmable":
            self.actions.set_armable(False, False)
        else:
            self.landed = telemetry.LandedState.IN_AIR if word == "fly" else telemetry.LandedState.ON_GROUND

    def go(self, for_s: float) -> None:
        if time.monotonic() - self.told_s > FAILSAFE_S:
            self.velocity = (0.0, 0.0)
        self.at = [at + rate * for_s for at, rate in zip(self.at, self.velocity, strict=True)]

    def tell(self) -> None:
        """Send position and landed state."""
        position, velocity = telemetry.PositionNed(*self.at, -10.0), telemetry.VelocityNed(*self.velocity, 0.0)
        self._telemetry.publish_position_velocity_ned(telemetry.PositionVelocityNed(position, velocity))
        self._telemetry.publish_extended_sys_state(telemetry.VtolState.UNDEFINED, self.landed)

    def beat(self) -> None:
        """Send what comes once a second; heartbeats MAVSDK sends by itself."""
        self._telemetry.publish_home(telemetry.Position(47.4, 8.5, 488.0, 0.0))
        self._telemetry.publish_battery(telemetry.Battery(15.2, 80.0))


class Person:
    """A ground station."""

    def __init__(self, port: int) -> None:
        self._mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        self._mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}")
        self._system: Any = None

    def do(self, word: str) -> None:
        self._system = self._system or self._mavsdk.first_autopilot(30.0)
        try:
            if word in ("arm", "disarm"):
                getattr(action.Action(self._system), word)()
                return
            fields = {"command": 176, "target_system": 1, "target_component": 1, "confirmation": 0}
            fields |= dict(zip((f"param{n}" for n in range(1, 8)), (1, MODES[word], 0, 0, 0, 0, 0), strict=True))
            command = mavlink_direct.MavlinkMessage("COMMAND_LONG", 245, 190, 1, 1, json.dumps(fields))
            mavlink_direct.MavlinkDirect(self._system).send_command(command)
        except MavsdkError as error:
            print(f"refused: {word}: {error}", file=sys.stderr, flush=True)


def main(port: int) -> None:
    """Go about until standard input ends."""
    own_port = free_port()
    vehicle, person = Vehicle(port, own_port), Person(own_port)
    is_over = threading.Event()

    def listen() -> None:
        for line in sys.stdin:
            word = line.strip()
            (person.do if word in ("arm", "disarm", *MODES) else vehicle.happen)(word)
        is_over.set()

    threading.Thread(target=listen, daemon=True).start()
    last_s = beat_s = time.monotonic()
    while not is_over.wait(STEP_S):
        now_s = time.monotonic()
        vehicle.go(now_s - last_s)
        last_s = now_s
        vehicle.tell()
        if now_s >= beat_s:
            beat_s = now_s + 1.0
            vehicle.beat()
        print(json.dumps([now_s, *vehicle.at, *vehicle.velocity, vehicle.set_points, 0.0]), flush=True)
    os._exit(0)


if __name__ == "__main__":
    main(int(sys.argv[1]))
