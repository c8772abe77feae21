"""Settings of a MAVLink vehicle (`mavlink.py`): its link, its frame, its limits."""

from dataclasses import dataclass
from importlib.util import find_spec

from deltaswarm_agent.bodies.events_file import file_problems
from deltaswarm_agent.bodies.fence import Fence, Place
from deltaswarm_agent.bodies.guard import Limits
from deltaswarm_agent.bodies.mavlink_link import MAX_BAUD, MIN_BAUD, parse_device
from deltaswarm_agent.bodies.mavlink_modes import MODES
from deltaswarm_wire.checked import Problem, key


@dataclass(frozen=True)
class MavlinkSettings:
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
    max_speed_mps: float = key(1.0, "speed limit of set-points [m/s]", above=0, high=30)
    fence_m: tuple[tuple[float, ...], ...] = key(
        (), "corners of the geofence [m; arena frame]; none: the arena plus fence_margin_m"
    )
    fence_margin_m: float = key(5.0, "margin around the arena without fence_m [m]", low=0)
    ahead_s: float = key(1.5, "time for which a velocity must stay inside the fence [s]", low=0, high=60)
    stall_s: float = key(0.5, "time without a command after which the vehicle must stop [s]", above=0, high=10)
    position_s: float = key(1.0, "maximum age of a position [s]", above=0, high=60)
    jump_m: float = key(5.0, "a jump of the position beyond what max_speed_mps allows is a fault [m]", above=0)
    follow_s: float = key(5.0, "not to have begun to follow set-points after this time is a fault [s]", low=1)
    heartbeat_s: float = key(3.0, "maximum age of a heartbeat [s]", above=0, high=60)
    needs_armed: bool = key(True, "wait for the vehicle to be armed")
    modes: tuple[str, ...] = key(
        ("GUIDED", "OFFBOARD"), "flight modes in which the agent is in control, in upper or lower case; none: all"
    )
    rate_hz: float = key(10.0, "set-points per second", low=3, high=100)
    std_m: float = key(0.3, "standard deviation of the position, until the vehicle sends one [m]", low=0)
    events: str = key("", "a CSV file of simulated events; empty: no events")

    def problems(self) -> list[Problem]:
        """Check what involves several keys."""
        problems = []
        if self.fence_m:
            try:
                Fence(self._corners())
            except ValueError as error:
                problems.append(Problem("fence_m", str([list(corner) for corner in self.fence_m])[:200], str(error)))
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
        return problems + file_problems(self.events)

    def _corners(self) -> list[Place]:
        if any(len(corner) != 2 for corner in self.fence_m):
            raise ValueError("must have corners of two numbers")
        return [(corner[0], corner[1]) for corner in self.fence_m]

    def fence(self, width_m: float, height_m: float) -> Fence:
        """Make the geofence for an arena of this size."""
        low, right, top = -self.fence_margin_m, width_m + self.fence_margin_m, height_m + self.fence_margin_m
        return Fence(self._corners() or [(low, low), (right, low), (right, top), (low, top)])

    def limits(self, step_s: float) -> Limits:
        """Make the guard's limits for an agent that commands once a step."""
        return Limits(
            max_speed_mps=self.max_speed_mps,
            command_s=step_s + self.stall_s,
            ahead_s=self.ahead_s,
            position_s=self.position_s,
            heartbeat_s=self.heartbeat_s,
            needs_armed=self.needs_armed,
            modes=tuple(mode.upper() for mode in self.modes),
            jump_m=self.jump_m,
            follow_s=self.follow_s,
        )
