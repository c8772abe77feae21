"""Settings of a MAVLink vehicle (`mavlink.py`): its link, its frame, its limits."""

from dataclasses import dataclass, replace
from importlib.util import find_spec

from deltaswarm_board.bodies.guard import Limits
from deltaswarm_board.bodies.guarded import GuardedSettings
from deltaswarm_board.bodies.mavlink_link import MAX_BAUD, MIN_BAUD, parse_device
from deltaswarm_board.bodies.mavlink_modes import MODES
from deltaswarm_wire.checked import Problem, key


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
        ("GUIDED", "OFFBOARD"), "flight modes in which the agent is in control, in upper or lower case; none: all"
    )

    def problems(self) -> list[Problem]:
        """Check what involves several keys."""
        problems = super().problems()
        try:
            kind = parse_device(self.device, self.baud).kind
        except ValueError as error:
            problems.append(Problem("device", repr(self.device), str(error)))
        else:
            for module, package in (("pymavlink", "pymavlink"), ("serial", "pyserial")):
                if (module != "serial" or kind == "serial") and find_spec(module) is None:
                    problems.append(
                        Problem(
                            "device",
                            repr(self.device),
                            f"must be another device without the package {package} (extra mavlink)",
                        )
                    )
        if unknown := [mode for mode in self.modes if mode.upper() not in MODES]:
            problems.append(Problem("modes", ", ".join(map(repr, unknown)), f"must be from {', '.join(sorted(MODES))}"))
        return problems

    def limits(self, step_s: float) -> Limits:
        """Make the guard's limits for an agent that commands once a step."""
        return replace(
            super().limits(step_s),
            heartbeat_s=self.heartbeat_s,
            needs_armed=self.needs_armed,
            modes=tuple(mode.upper() for mode in self.modes),
        )
