"""Names of flight modes, as in ground stations, from the numbers in a heartbeat."""

from collections.abc import Mapping
from types import MappingProxyType

CUSTOM_MODE = 1
"""The flag in a heartbeat's `base_mode`: the mode is in `custom_mode`."""

PX4 = 12
"""The heartbeat's `autopilot` of a PX4."""

UNKNOWN = "UNKNOWN"


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


def mode_name(autopilot: int, vehicle: int, base_mode: int, custom_mode: int) -> str:
    """Name the mode in a heartbeat; an unknown one is `Mode(NUMBER)`."""
    if autopilot == PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        name = _PX4.get(main, UNKNOWN)
        return _PX4_AUTO.get(sub, UNKNOWN) if name == "AUTO" else name
    if not base_mode & CUSTOM_MODE:
        return f"Mode(0x{base_mode:08x})"
    return _ARDUPILOT.get(vehicle, {}).get(custom_mode, f"Mode({custom_mode})")
