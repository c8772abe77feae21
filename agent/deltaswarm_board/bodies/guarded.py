"""Options and behaviour shared by the bodies that drive a real robot through a guard."""

import abc
import logging
import threading
import time
from dataclasses import dataclass
from typing import ClassVar

from deltaswarm_agent.body import BodyContext, Sensed
from deltaswarm_board.bodies.events_file import event_field, file_problems
from deltaswarm_board.bodies.fence import Fence, Place
from deltaswarm_board.bodies.guard import Guard, GuardLimits, Velocity
from deltaswarm_wire.checked import Problem, key

log = logging.getLogger("deltaswarm.body")


@dataclass(frozen=True)
class GuardedSettings:
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
    rate_hz: float = key(10.0, "set-points per second", low=3, high=100)
    std_m: float = key(0.3, "standard deviation of the position, until the vehicle sends one [m]", low=0)
    events: str = key("", "a CSV file of simulated events; empty: no events")

    def problems(self) -> list[Problem]:
        problems = file_problems(self.events)
        if self.fence_m:
            try:
                Fence(self._corners())
            except ValueError as error:
                problems.append(Problem("fence_m", str([list(corner) for corner in self.fence_m])[:200], str(error)))
        return problems

    def _corners(self) -> list[Place]:
        if any(len(corner) != 2 for corner in self.fence_m):
            raise ValueError("must have corners of two numbers")
        return [(corner[0], corner[1]) for corner in self.fence_m]

    def fence(self, width_m: float, height_m: float) -> Fence:
        low, right, top = -self.fence_margin_m, width_m + self.fence_margin_m, height_m + self.fence_margin_m
        return Fence(self._corners() or [(low, low), (right, low), (right, top), (low, top)])

    def limits(self, step_s: float) -> GuardLimits:
        """Make the guard's limits for an agent that commands once a step."""
        return GuardLimits(
            max_speed_mps=self.max_speed_mps,
            command_s=step_s + self.stall_s,
            ahead_s=self.ahead_s,
            position_s=self.position_s,
            jump_m=self.jump_m,
            follow_s=self.follow_s,
        )


class GuardedBody(abc.ABC):
    """A robot whose thread sends what the guard permits; `sense` and `move` are calls of the agent's thread."""

    CLOSE_S: ClassVar[float]
    """Time that the robot's thread has to stop the robot [s]."""

    def __init__(self, options: GuardedSettings, context: BodyContext) -> None:
        agent = context.settings
        self._guard = Guard(options.limits(agent.step_s), options.fence(agent.width_m, agent.height_m), options.std_m)
        self._surroundings = event_field(options.events, agent.sensing_range_m)
        self._observed: tuple[int, ...] = ()
        self._sensed_s = 0.0
        self._lock = threading.Lock()
        """Guards `_guard`, and what a subclass says."""
        self._no_link = ""
        """Why there is no link to the robot; "" if there is one."""
        self._told_stalls = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="robot", daemon=True)

    def sense(self, time_s: float) -> Sensed:
        with self._lock:
            sensed = self._guard.sensed(time.monotonic())
        if self._no_link:
            return sensed._replace(fault=self._no_link)
        if sensed.fault:
            return sensed
        at = (sensed.x_m, sensed.y_m)
        self._surroundings.observe(self._observed, *at, time_s, time_s - self._sensed_s)
        self._sensed_s = time_s
        return sensed._replace(events=self._surroundings.sensed(*at, time_s, at))

    def move(self, vx_mps: float, vy_mps: float, observed: tuple[int, ...]) -> None:
        """Pass a velocity to the guard; the robot gets it with the next set-point."""
        self._observed = observed
        with self._lock:
            self._guard.command(vx_mps, vy_mps, time.monotonic())

    def close(self) -> None:
        """Stop the robot and its thread."""
        with self._lock:
            self._guard.command(0.0, 0.0, time.monotonic())
        self._closing.set()
        self._thread.join(self.CLOSE_S)
        log.info(
            "set-points refused at the fence: %d; stalls of the agent: %d", self._guard.refused, self._guard.stalls
        )

    @abc.abstractmethod
    def _serve(self) -> None:
        """Send set-points until the body is closed; the main function of the robot's thread."""

    def _next_velocity(self, now_s: float) -> Velocity:
        """Return the velocity to send now [m/s; arena frame], and log a stall of the agent."""
        with self._lock:
            velocity, stalls = self._guard.velocity(now_s), self._guard.stalls
        if stalls > self._told_stalls:
            self._told_stalls = stalls
            log.warning("stall %d of the agent: the robot must stand", stalls)
        return velocity
