"""A body that is a MAVLink vehicle: local position in, velocity set-points out. Needs `pymavlink` (extra `mavlink`).

The body does not arm, take off or change the flight mode: a pilot does, and regains control by leaving the mode. A
separate thread sends set-points ten times a second and stops the vehicle when the agent stalls. If the whole process
dies, set-points cease and the vehicle's own failsafe must act: COM_OF_LOSS_T in PX4 (1 s by default), GUID_TIMEOUT in
ArduPilot's copters (3 s); its rovers always stop after 3 s.

This is the only file that speaks MAVLink. From pymavlink it uses only a dialect, the protocol itself, and not
`mavutil`, which loads another dialect, numpy and more, and triples the memory.
"""

import logging
import math
import time
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

from deltaswarm_agent.body import BodyContext
from deltaswarm_board.bodies.guard import STAND
from deltaswarm_board.bodies.guarded import GuardedBody
from deltaswarm_board.bodies.mavlink_link import open_link, parse_device
from deltaswarm_board.bodies.mavlink_settings import PX4, ROVERS, SUBMARINE, MavlinkSettings, mode_name


class LocalFrame(NamedTuple):
    """The arena's corner (0, 0) [m; local NED] and the compass direction of its +y [degrees]."""

    origin_north_m: float = 0.0
    origin_east_m: float = 0.0
    heading_deg: float = 0.0

    def to_arena(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Convert a position in local NED to (x, y) in the arena."""
        return self.turned_to_arena(north_m - self.origin_north_m, east_m - self.origin_east_m)

    def turned_to_arena(self, north: float, east: float) -> tuple[float, float]:
        """Convert a vector (m or m/s) in local NED to (x, y)."""
        sine, cosine = self._turn()
        return cosine * east - sine * north, sine * east + cosine * north

    def turned_to_ned(self, x: float, y: float) -> tuple[float, float]:
        """Convert a vector (m or m/s) in the arena to (north, east)."""
        sine, cosine = self._turn()
        return cosine * y - sine * x, sine * y + cosine * x

    def _turn(self) -> tuple[float, float]:
        heading_rad = math.radians(self.heading_deg)
        return math.sin(heading_rad), math.cos(heading_rad)


log = logging.getLogger("deltaswarm.mavlink")

VELOCITY_ONLY = 0b0000_1101_1100_0111
"""Set-point mask: ignore position, acceleration, yaw and yaw rate."""

STAND_STILL = 0b0000_0101_1100_0111
"""The same with a yaw rate of zero: without yaw a rover turns towards its velocity, and a zero velocity points
north."""

HEARTBEAT_EVERY_S = 1.0
ASK_AFTER_S = 2.0
"""A message missing for this long is requested again, since the autopilot may have restarted."""

STATE_EVERY_S = 0.5
RESTARTED_MS = 1000
"""If the autopilot's clock goes back by more, it restarted; by less, datagrams were reordered."""

UNHEARD_S = 5.0
"""An autopilot that was not heard for longer may have restarted meanwhile, and its clock be ahead all the same."""

TWO_VEHICLES = "two vehicles have its number: messages come from two addresses"
NOT_IN_THE_AIR = "the vehicle is not in the air"
RESTARTED = "the autopilot restarted, and its local frame may have moved: restart the agent"
RETRY_S = 1.0


def has_restarted(before_ms: int, boot_ms: int, passed_s: float) -> bool:
    """Whether an autopilot's clock shows that it has started again: it went back, or hardly on while nobody heard it.

    Args:
        before_ms: its time since it started, when it was heard before; it begins anew after 50 days.
        boot_ms: the same now.
        passed_s: the time between by this machine's clock.
    """
    gone_ms = (boot_ms - before_ms) & 0xFFFF_FFFF
    if gone_ms >= 0x8000_0000:
        return 0x1_0000_0000 - gone_ms > RESTARTED_MS
    return passed_s > UNHEARD_S and gone_ms < 500 * passed_s


class MavlinkBody(GuardedBody):
    """One vehicle, which may appear later and disappear; meanwhile the body has a fault."""

    Settings: ClassVar[type[Any]] = MavlinkSettings
    REAL_TIME: ClassVar[bool] = True
    CLOSE_S: ClassVar[float] = 1.0

    def __init__(self, options: MavlinkSettings, context: BodyContext) -> None:
        super().__init__(options, context)
        self._options = options
        self._frame = LocalFrame(options.origin_north_m, options.origin_east_m, options.heading_deg)
        self._target: tuple[int, int] | None = None
        self._flies = False
        self._landed_state: int | None = None
        self._is_px4 = False
        self._has_restarted = False
        self._peer_heard_s = self._rival_heard_s = -math.inf
        """When the vehicle's newest heartbeat came from its address, and one with its number from another one."""
        self._others: set[tuple[int, int]] = set()
        """Other autopilots that were heard."""
        self._boot: tuple[int | None, float] = None, 0.0
        """The autopilot's time since it started [ms], and when it was heard (monotonic) [s]."""
        self._came_s: dict[int, float] = {}
        self._mavlink = _dialect()
        self._link = open_link(parse_device(options.device, options.baud))
        self._mav = self._parser()
        self._thread.start()

    # The agent's thread

    def close(self) -> None:
        super().close()
        self._link.close()

    # The vehicle's thread

    def _serve(self) -> None:
        """Receive messages and send set-points at `rate_hz`; retry the link without end."""
        set_point_due_s = heartbeat_due_s = time.monotonic()
        while True:
            is_last = self._closing.is_set()
            now_s = time.monotonic()
            try:
                self._link.open()
                if now_s >= heartbeat_due_s:
                    heartbeat_due_s = now_s + HEARTBEAT_EVERY_S
                    self._send_heartbeat()
                    self._ask(now_s)
                if now_s >= set_point_due_s or is_last:
                    set_point_due_s = now_s + 1.0 / self._options.rate_hz
                    self._send_set_point(now_s)
                if is_last:
                    return
                data = self._link.receive(max(0.001, min(set_point_due_s, heartbeat_due_s) - now_s))
                self._no_link = ""
                is_peer = self._link.sender == self._link.peer
                for message in self._messages(self._mav if is_peer else self._parser(), data):
                    self._handle(message, time.monotonic())
            except OSError as error:
                self._no_link = f"no link to {self._options.device}: {error.strerror or error}"
                if is_last or self._closing.wait(RETRY_S):
                    return

    def _parser(self) -> Any:
        """Make a parser and sender of messages; strangers' bytes get one of their own, as they may be no messages."""
        made = self._mavlink.MAVLink(self._link, self._options.system_id, self._mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
        made.robust_parsing = True  # skip bytes that are no message
        return made

    @staticmethod
    def _messages(parser: Any, data: bytes) -> Iterator[Any]:
        """Parse messages; feed the parser only what it needs, or its buffer would grow."""
        at = 0
        while at < len(data):
            until = at + parser.bytes_needed()
            message = parser.parse_char(data[at:until])
            at = until
            if message is not None:
                yield message

    def _handle(self, message: Any, now_s: float) -> None:
        mavlink = self._mavlink
        source = (message.get_srcSystem(), message.get_srcComponent())
        match message.get_msgId():
            case mavlink.MAVLINK_MSG_ID_HEARTBEAT if self._is_of_the_vehicle(message, source, now_s):
                self._hear_heartbeat(message, source, now_s)
            case _ if source != self._target or self._link.sender != self._link.peer:
                return
            case mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED as kind:
                self._came_s[kind] = now_s
                self._note_boot_time(message.time_boot_ms)
                at = self._frame.to_arena(message.x, message.y)
                with self._lock:
                    self._guard.locate(*at, now_s)
            case mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE as kind:
                self._came_s[kind] = now_s
                self._landed_state = message.landed_state
                self._inhibit()
            case mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS:
                with self._lock:
                    self._guard.set_uncertainty(message.pos_horiz_accuracy)

    def _is_of_the_vehicle(self, heartbeat: Any, source: tuple[int, int], now_s: float) -> bool:
        """Whether it is from the vehicle that is flown: no ground station, companion or other autopilot.

        What comes from another address is not believed as long as the vehicle's own address is heard.
        """
        if heartbeat.autopilot == self._mavlink.MAV_AUTOPILOT_INVALID:
            return False
        is_wanted = self._options.vehicle in (0, source[0]) and self._target in (None, source)
        if not is_wanted:
            if source not in self._others:
                self._others.add(source)
                log.warning("autopilot %d is heard, too; the vehicle is %s", source[0], self._vehicle)
            return False
        sender, is_lost = self._link.sender, now_s - self._peer_heard_s > self._options.heartbeat_s
        if self._target is not None and sender != self._link.peer and not is_lost:
            self._rival_heard_s = now_s
            self._inhibit()
            return False
        self._link.peer, self._peer_heard_s = sender, now_s
        return True

    @property
    def _vehicle(self) -> str:
        number = self._options.vehicle or (self._target[0] if self._target else 0)
        return str(number) if number else "not known yet"

    def _hear_heartbeat(self, heartbeat: Any, source: tuple[int, int], now_s: float) -> None:
        if self._target is None:
            self._target = source
            log.info("vehicle %d found", source[0])
            self._ask(now_s)
        self._is_px4 = heartbeat.autopilot == PX4
        self._flies = heartbeat.type not in (*ROVERS, SUBMARINE)
        is_armed = bool(heartbeat.base_mode & self._mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        mode = mode_name(heartbeat.autopilot, heartbeat.type, heartbeat.base_mode, heartbeat.custom_mode)
        with self._lock:
            self._guard.beat(is_armed, mode, now_s)
        self._inhibit()

    @property
    def _is_grounded(self) -> bool:
        # Assume that an aircraft is on the ground until it says otherwise: it may be taking off.
        mavlink = self._mavlink
        grounded = (
            None,
            mavlink.MAV_LANDED_STATE_ON_GROUND,
            mavlink.MAV_LANDED_STATE_TAKEOFF,
            mavlink.MAV_LANDED_STATE_LANDING,
        )
        return self._flies and self._landed_state in grounded

    def _note_boot_time(self, boot_ms: int) -> None:
        (before_ms, before_s), now_s = self._boot, time.monotonic()
        self._boot = boot_ms, now_s
        if before_ms is not None and has_restarted(before_ms, boot_ms, now_s - before_s):
            self._has_restarted = True
            self._inhibit()
            log.warning("%s", RESTARTED)

    def _inhibit(self) -> None:
        is_doubtful = time.monotonic() - self._rival_heard_s <= self._options.heartbeat_s
        reasons = ((self._has_restarted, RESTARTED), (is_doubtful, TWO_VEHICLES), (self._is_grounded, NOT_IN_THE_AIR))
        reason_to_stand = next((reason for holds, reason in reasons if holds), "")
        with self._lock:
            self._guard.inhibit(reason_to_stand)

    def _ask(self, now_s: float) -> None:
        # Request missing messages: positions at the rate of set-points, and the landed state.
        mavlink = self._mavlink
        wanted = {
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0 / self._options.rate_hz,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: STATE_EVERY_S,
        }
        for kind, every_s in wanted.items():
            if self._target is not None and now_s - self._came_s.get(kind, -math.inf) > ASK_AFTER_S:
                command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
                self._mav.command_long_send(*self._target, command, 0, kind, every_s * 1e6, *(0.0,) * 5)

    def _send_heartbeat(self) -> None:
        mavlink = self._mavlink
        self._mav.heartbeat_send(
            mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE
        )

    def _send_set_point(self, now_s: float) -> None:
        velocity = self._next_velocity(now_s)
        # A set-point would end an ArduPilot's take-off; a PX4 requires them before it changes to OFFBOARD.
        if self._target is None or (self._is_grounded and not self._is_px4):
            return
        north_mps, east_mps = self._frame.turned_to_ned(*velocity)
        self._mav.set_position_target_local_ned_send(
            int(now_s * 1000) & 0xFFFF_FFFF,
            *self._target,
            self._mavlink.MAV_FRAME_LOCAL_NED,
            STAND_STILL if velocity == STAND else VELOCITY_ONLY,
            *(0.0, 0.0, 0.0),
            *(north_mps, east_mps, 0.0),
            *(0.0,) * 5,
        )


def _dialect() -> Any:
    # MAVLink 2 without messages of a specific autopilot: the smallest dialect with set-points.
    from pymavlink.dialects.v20 import common

    return common
