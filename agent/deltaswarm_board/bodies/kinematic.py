"""A body without hardware: a noisy unicycle whose odometry drifts and is corrected periodically.

Only this file knows the true position; the agent gets the believed one. All randomness comes from the given generator,
so equal seeds and commands give equal motion.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from deltaswarm_agent.body import BodyContext, Sensed
from deltaswarm_board.bodies.events_file import event_field, file_problems
from deltaswarm_wire.checked import Problem, key

SUBSTEP_S = 0.1
"""Longest integration step of the motion [s]."""


@dataclass(frozen=True)
class KinematicSettings:
    """The unicycle, its errors, and its events."""

    x_m: float = key(0.0, "start position along x [m]")
    y_m: float = key(0.0, "start position along y [m]")
    heading_rad: float = key(0.0, "start heading [rad from x towards y]")
    turn_rate_radps: float = key(3.0, "fastest turn [rad/s]", above=0)
    speed_noise: float = key(0.02, "standard deviation of the speed, per speed", low=0, high=1)
    turn_noise_rad: float = key(0.02, "standard deviation of the heading per square root of a second [rad]", low=0)
    drift: float = key(0.02, "error of odometry per square root of a metre driven [m], along each axis", low=0)
    fix_interval_s: float = key(10.0, "interval between position fixes [s]; 0: never", low=0)
    fix_std_m: float = key(0.02, "position error after a fix, along each axis [m]", low=0)
    events: str = key("", "a CSV file of events; empty: no events")

    def problems(self) -> list[Problem]:
        return file_problems(self.events)


class KinematicBody:
    """One unicycle. Positions in m, arena frame; headings in rad from x towards y."""

    Settings: ClassVar[type[Any]] = KinematicSettings
    REAL_TIME: ClassVar[bool] = False

    def __init__(self, options: KinematicSettings, context: BodyContext) -> None:
        self.true_m = (options.x_m, options.y_m)
        self.heading_rad = options.heading_rad
        self._options = options
        self._rng = context.rng
        self._top_mps = context.settings.speed_mps
        self._hold_s = 2 * context.settings.step_s
        self._surroundings = event_field(options.events, context.settings.sensing_range_m)
        self._error_m = self._fixed()
        self._since_fix_m = 0.0
        self._time_s = 0.0
        self._fix_due_s = options.fix_interval_s
        self._velocity = (0.0, 0.0)
        self._observed: tuple[int, ...] = ()
        self._until_s = 0.0

    def sense(self, time_s: float) -> Sensed:
        worked_s = max(0.0, min(time_s, self._until_s) - self._time_s)
        self._surroundings.observe(self._observed, *self.true_m, self._time_s, worked_s)
        while self._time_s < time_s:
            piece_s = min(SUBSTEP_S, time_s - self._time_s)
            self._drive(piece_s)
            self._time_s = min(self._time_s + piece_s, time_s) if piece_s == SUBSTEP_S else time_s
        if self._options.fix_interval_s and time_s >= self._fix_due_s:
            self._fix_due_s = time_s + self._options.fix_interval_s
            self._since_fix_m = 0.0
            self._error_m = self._fixed()
        believed = (self.true_m[0] + self._error_m[0], self.true_m[1] + self._error_m[1])
        std_m = math.sqrt(self._options.fix_std_m**2 + self._options.drift**2 * self._since_fix_m)
        return Sensed(*believed, std_m, self._surroundings.sensed(*self.true_m, time_s, believed))

    def move(self, vx_mps: float, vy_mps: float, observed: tuple[int, ...]) -> None:
        """Take a command, which holds for two steps."""
        self._velocity = (vx_mps, vy_mps)
        self._observed = observed
        self._until_s = self._time_s + self._hold_s

    def close(self) -> None:
        self._velocity = (0.0, 0.0)

    def _fixed(self) -> tuple[float, float]:
        return self._rng.gauss(0.0, self._options.fix_std_m), self._rng.gauss(0.0, self._options.fix_std_m)

    def _drive(self, piece_s: float) -> None:
        """Turn towards the commanded velocity, and drive in proportion to the alignment with it."""
        vx_mps, vy_mps = self._velocity
        speed_mps = min(math.hypot(vx_mps, vy_mps), self._top_mps)
        if speed_mps == 0.0 or self._time_s >= self._until_s:
            return
        options, rng = self._options, self._rng
        turn_rad = math.remainder(math.atan2(vy_mps, vx_mps) - self.heading_rad, math.tau)
        most_rad = options.turn_rate_radps * piece_s
        self.heading_rad += max(-most_rad, min(most_rad, turn_rad))
        left_rad = math.remainder(math.atan2(vy_mps, vx_mps) - self.heading_rad, math.tau)
        self.heading_rad += rng.gauss(0.0, options.turn_noise_rad) * math.sqrt(piece_s)
        length_m = speed_mps * piece_s * max(0.0, math.cos(left_rad))
        driven_m = min(length_m * max(0.0, 1.0 + rng.gauss(0.0, options.speed_noise)), self._top_mps * piece_s)
        heading_rad = self.heading_rad
        self.true_m = (
            self.true_m[0] + driven_m * math.cos(heading_rad),
            self.true_m[1] + driven_m * math.sin(heading_rad),
        )
        off_m = options.drift * math.sqrt(driven_m)
        self._error_m = (self._error_m[0] + rng.gauss(0.0, off_m), self._error_m[1] + rng.gauss(0.0, off_m))
        self._since_fix_m += driven_m
