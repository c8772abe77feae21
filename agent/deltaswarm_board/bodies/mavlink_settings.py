"""Settings of a MAVLink vehicle (`mavlink.py`): its link, its frame, its limits, and the names of flight modes."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from deltaswarm_board.bodies.guard import GuardLimits
from deltaswarm_board.bodies.guarded import GuardedSettings
from deltaswarm_board.bodies.mavlink_link import MAX_BAUD, MIN_BAUD, parse_device
from deltaswarm_wire.checked import Problem, key
from deltaswarm_wire.extras import missing

CUSTOM_MODE = 1
"""The flag in a heartbeat's `base_mode`: the mode is in `custom_mode`."""

PX4 = 12
"""The heartbeat's `autopilot` of a PX4."""

UNKNOWN = "UNKNOWN"

_NUMBER = re.compile(r"Mode\((\d+|0x[0-9a-f]{8})\)")
"""What a mode without a known name is called."""


def _numbered(names: str) -> Mapping[int, str]:
    """Map numbers to names, given in order; a dash leaves a number out."""
    return MappingProxyType({number: name for number, name in enumerate(names.split()) if name != "-"})


_COPTER = _numbered(
    "STABILIZE ACRO ALT_HOLD AUTO GUIDED LOITER RTL CIRCLE POSITION LAND OF_LOITER DRIFT - SPORT FLIP AUTOTUNE POSHOLD"
    " BRAKE THROW AVOID_ADSB GUIDED_NOGPS SMART_RTL FLOWHOLD FOLLOW ZIGZAG SYSTEMID AUTOROTATE AUTO_RTL TURTLE"
)
_PLANE = _numbered(
    "MANUAL CIRCLE STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE - AUTO RTL LOITER TAKEOFF AVOID_ADSB GUIDED"
    " INITIALISING QSTABILIZE QHOVER QLOITER QLAND QRTL QAUTOTUNE QACRO THERMAL"
)
_ROVER = _numbered(
    "MANUAL ACRO LEARNING STEERING HOLD LOITER FOLLOW SIMPLE DOCK CIRCLE AUTO RTL SMART_RTL - - GUIDED INITIALISING"
)
_SUB = _numbered("STABILIZE ACRO ALT_HOLD AUTO GUIDED - - CIRCLE - SURFACE - - - - - - POSHOLD - - MANUAL")

ROVERS = frozenset((10, 11))
"""MAV_TYPE of rovers and boats."""

SUBMARINE = 12

_ARDUPILOT = {
    **dict.fromkeys((2, 3, 4, 13, 14, 15, 29, 35), _COPTER),
    **dict.fromkeys((1, 19, 20, 21), _PLANE),
    **dict.fromkeys(ROVERS, _ROVER),
    SUBMARINE: _SUB,
}
"""By MAV_TYPE."""

_PX4 = _numbered("- MANUAL ALTCTL POSCTL AUTO ACRO OFFBOARD STABILIZED RATTITUDE")
_PX4_AUTO = _numbered("- - TAKEOFF LOITER MISSION RTL LAND RTGS FOLLOWME")

MODES = frozenset(name for numbered in (_COPTER, _PLANE, _ROVER, _SUB, _PX4, _PX4_AUTO) for name in numbered.values())
"""All names, in capitals."""


def _spelt(mode: str) -> str:
    """Spell a mode as `mode_name` does, whatever its case."""
    return mode.capitalize() if _NUMBER.fullmatch(mode.capitalize()) else mode.upper()


def _is_mode(name: str) -> bool:
    return name in MODES or _NUMBER.fullmatch(name) is not None


def mode_name(autopilot: int, vehicle: int, base_mode: int, custom_mode: int) -> str:
    """Name the mode in a heartbeat; an unknown one is `Mode(NUMBER)`."""
    if autopilot == PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        name = _PX4.get(main, UNKNOWN)
        return _PX4_AUTO.get(sub, UNKNOWN) if name == "AUTO" else name
    if not base_mode & CUSTOM_MODE:
        return f"Mode(0x{base_mode:08x})"
    return _ARDUPILOT.get(vehicle, {}).get(custom_mode, f"Mode({custom_mode})")


@dataclass(frozen=True)
class MavlinkSettings(GuardedSettings):
    """The vehicle, its frame, and its limits."""

    device: str = key(
        "udpin:0.0.0.0:14540", "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, or a serial device (/dev/...)"
    )
    baud: int = key(115200, "baud rate of a serial device", low=MIN_BAUD, high=MAX_BAUD)
    system_id: int = key(245, "this board's own MAVLink number", low=1, high=255)
    vehicle: int = key(0, "the vehicle's MAVLink number; 0: that of the first autopilot heard", low=0, high=255)
    origin_north_m: float = key(0.0, "the arena's corner (0, 0), north in the vehicle's local frame [m]")
    origin_east_m: float = key(0.0, "the arena's corner (0, 0), east in the vehicle's local frame [m]")
    heading_deg: float = key(
        0.0, "compass direction of the arena's +y; with 0 x is east and y north", low=-360, high=360
    )
    heartbeat_s: float = key(3.0, "maximum age of a heartbeat [s]", above=0, high=60)
    needs_armed: bool = key(True, "wait for the vehicle to be armed")
    modes: tuple[str, ...] = key(
        ("GUIDED", "OFFBOARD"),
        "flight modes in which the agent is in control, in upper or lower case; Mode(7): one without a name; none: all",
    )

    def problems(self) -> list[Problem]:
        problems = super().problems()
        try:
            kind = parse_device(self.device, self.baud).kind
        except ValueError as error:
            problems.append(Problem("device", repr(self.device), str(error)))
        else:
            if needs := missing("pymavlink", *(["serial"] if kind == "serial" else [])):
                problems.append(Problem("device", repr(self.device), needs))
        if unknown := [mode for mode in self.modes if not _is_mode(_spelt(mode))]:
            rule = f"must be Mode(NUMBER) or from {', '.join(sorted(MODES))}"
            problems.append(Problem("modes", ", ".join(map(repr, unknown)), rule))
        return problems

    def limits(self, step_s: float) -> GuardLimits:
        return replace(
            super().limits(step_s),
            heartbeat_s=self.heartbeat_s,
            needs_armed=self.needs_armed,
            modes=tuple(map(_spelt, self.modes)),
        )
