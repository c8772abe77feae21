"""Safety limits between an agent and a real vehicle: fence, speed limit, watchdog. All times in s."""

import math
from dataclasses import dataclass

from deltaswarm_agent.body import NOWHERE, Sensed
from deltaswarm_board.bodies.fence import Fence

Velocity = tuple[float, float]

STAND: Velocity = (0.0, 0.0)

UNCERTAIN_S = 5.0
"""Time for which a vehicle stands after its position or obedience became doubtful [s]."""

LEAST_SHARE = 0.2
"""A vehicle that obeys covers at least this share of the way that it is told, in the direction of it."""

LEAST_M = 1.0
"""A shorter way tells nothing, as positions are not exact [m]."""


@dataclass(frozen=True)
class GuardLimits:
    max_speed_mps: float
    command_s: float
    """Lifetime of a command; after it the agent has stalled, and the vehicle stands."""
    ahead_s: float
    """Time for which a velocity must keep the vehicle inside its fence."""
    position_s: float
    """Maximum age of a position."""
    heartbeat_s: float = math.inf
    """Maximum age of a heartbeat."""
    needs_armed: bool = False
    modes: tuple[str, ...] = ()
    """Flight modes in which the agent is in control; empty: all."""
    jump_m: float = math.inf
    """A position this much farther away than the speed limit allows is doubtful."""
    follow_s: float = math.inf
    """Time of set-points in which the vehicle must have begun to follow them."""

    @property
    def how_to_go_on(self) -> str:
        """What a person does after a jump, once the frame is right again."""
        if self.modes:
            return "check its frame, then leave the flight mode and come back, or restart the agent"
        return "check its frame, then restart the agent"

    def leaves_to_agent(self, is_armed: bool, mode: str) -> bool:
        """Whether a vehicle in this state is the agent's to move."""
        return (is_armed or not self.needs_armed) and (not self.modes or mode in self.modes)


class Obedience:
    """Compares where a vehicle is with where it was told to go; without an answer in time it is doubtful."""

    def __init__(self, limits: GuardLimits) -> None:
        self._limits = limits
        self._at: tuple[float, float] | None = None
        self._at_s = -math.inf
        self._sent, self._sent_s = STAND, -math.inf
        self._told_m = (0.0, 0.0)
        self._from: tuple[float, float] | None = None
        self._from_s = -math.inf
        self._reason, self._uncertain_until_s = "", -math.inf
        self._jumped = ""
        """How the position jumped; "" if it did not. The frame may have moved, which only a person can see."""

    def locate(self, at: tuple[float, float], now_s: float) -> None:
        before, before_s = self._at, self._at_s
        self._at, self._at_s = at, now_s
        if before is not None:
            far_m = math.dist(before, at)
            if far_m > self._limits.jump_m + self._limits.max_speed_mps * (now_s - before_s):
                self._jumped = f"its position jumped by {far_m:.1f} m: {self._limits.how_to_go_on}"

    def send(self, velocity: Velocity, now_s: float) -> None:
        """Note a set-point [m/s]; standing begins anew."""
        if velocity == STAND or self._at is None:
            self._from = None
        elif self._from is None:
            self._from, self._from_s, self._told_m = self._at, now_s, (0.0, 0.0)
        else:
            lasted_s = now_s - self._sent_s
            self._told_m = (self._told_m[0] + self._sent[0] * lasted_s, self._told_m[1] + self._sent[1] * lasted_s)
            if now_s - self._from_s >= self._limits.follow_s:
                self._compare(self._from, self._at, now_s)
        self._sent, self._sent_s = velocity, now_s

    def _compare(self, start: tuple[float, float], at: tuple[float, float], now_s: float) -> None:
        told_x_m, told_y_m = self._told_m
        told_m = math.hypot(told_x_m, told_y_m)
        along_m = ((at[0] - start[0]) * told_x_m + (at[1] - start[1]) * told_y_m) / told_m if told_m else 0.0
        if told_m >= LEAST_M and along_m < LEAST_SHARE * told_m:
            self._distrust(f"it does not follow its set-points: {along_m:.1f} of {told_m:.1f} m", now_s)
        self._from = None

    def _distrust(self, reason: str, now_s: float) -> None:
        self._reason, self._uncertain_until_s = reason, now_s + UNCERTAIN_S

    def reason_to_stand(self, now_s: float) -> str:
        """Why the vehicle must not move now, in a few words; "" if it may."""
        return self._jumped or (self._reason if now_s < self._uncertain_until_s else "")

    def trust(self) -> None:
        """Take the position as right from now on: a person has looked."""
        self._jumped, self._at = "", None


class Guard:
    """Decides the velocity to send [m/s; arena frame] and whether the body is well."""

    def __init__(self, limits: GuardLimits, fence: Fence, std_m: float) -> None:
        self.refused = 0
        """Set-points that would have left the fence."""
        self.stalls = 0
        """Number of times that the agent stopped commanding."""
        self._limits = limits
        self._fence = fence
        self._std_m = std_m
        self._at: tuple[float, float] | None = None
        self._at_s = -math.inf
        self._heard_s = -math.inf
        self._is_armed = False
        self._inhibited_by = ""
        self._mode = ""
        self._wanted = STAND
        self._wanted_s = -math.inf
        self._is_stalled = True
        self._obedience = Obedience(limits)

    def command(self, vx_mps: float, vy_mps: float, now_s: float) -> None:
        """Take the agent's velocity, cut to the speed limit with its direction kept."""
        speed_mps = math.hypot(vx_mps, vy_mps)
        share = min(1.0, self._limits.max_speed_mps / speed_mps) if speed_mps else 0.0
        self._wanted = (vx_mps * share, vy_mps * share) if math.isfinite(speed_mps) else STAND
        self._wanted_s = now_s
        self._is_stalled = False

    def locate(self, x_m: float, y_m: float, now_s: float) -> None:
        if math.isfinite(x_m) and math.isfinite(y_m):
            self._at, self._at_s = (x_m, y_m), now_s
            self._obedience.locate((x_m, y_m), now_s)

    def set_uncertainty(self, std_m: float) -> None:
        if math.isfinite(std_m) and std_m >= 0.0:
            self._std_m = std_m

    def beat(self, is_armed: bool, mode: str, now_s: float) -> None:
        """Take a heartbeat. A person who gives the vehicle to the agent again has looked where it is."""
        if self._limits.leaves_to_agent(is_armed, mode) and not self._limits.leaves_to_agent(
            self._is_armed, self._mode
        ):
            self._obedience.trust()
        self._is_armed, self._mode, self._heard_s = is_armed, mode, now_s

    def inhibit(self, reason: str) -> None:
        """Set why the vehicle must not move, in a few words; "" if it may."""
        self._inhibited_by = reason

    def velocity(self, now_s: float) -> Velocity:
        """Return the velocity to send now: the agent's, or zero."""
        velocity = self._permitted(now_s)
        self._obedience.send(velocity, now_s)
        return velocity

    def permits(self, velocity: Velocity) -> bool:
        """Whether the fence lets the vehicle, where it is, take a velocity [m/s; arena frame]."""
        return self._at is not None and self._fence.permits(self._at, *velocity, self._limits.ahead_s)

    def _permitted(self, now_s: float) -> Velocity:
        if now_s - self._wanted_s > self._limits.command_s:
            self.stalls += not self._is_stalled
            self._is_stalled = True
            return STAND
        if self._fault(now_s):
            return STAND
        if not self.permits(self._wanted):
            self.refused += 1
            return STAND
        return self._wanted

    def sensed(self, now_s: float) -> Sensed:
        """Return the position and the fault of the vehicle, without events."""
        at = NOWHERE if self._at is None else Sensed(*self._at, self._std_m)
        return at._replace(fault=self._fault(now_s))

    def _fault(self, now_s: float) -> str:
        limits = self._limits
        if now_s - self._heard_s > limits.heartbeat_s:
            return "no heartbeat from the vehicle"
        if self._at is None or now_s - self._at_s > limits.position_s:
            return "no position from the vehicle"
        if limits.needs_armed and not self._is_armed:
            return "the vehicle is not armed"
        if limits.modes and self._mode not in limits.modes:
            return f"the vehicle is in mode {self._mode}"
        return self._reason_to_stand(now_s)

    def _reason_to_stand(self, now_s: float) -> str:
        """Why the vehicle must not move though it is located; "" if it may."""
        if self._inhibited_by:
            return self._inhibited_by
        if self._at is not None and not self._fence.holds(self._at):
            return "the vehicle is outside its fence"
        return self._obedience.reason_to_stand(now_s)
