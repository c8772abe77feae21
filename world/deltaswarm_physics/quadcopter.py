"""One F450 quadcopter of JSBSim, and the outer loops by which it takes up a velocity and holds its height.

The aircraft is the one that comes with JSBSim: airframe, motors, propellers and rate loops. The velocity's error gives
an attitude, the attitude's error the rates that its own loops take up, and the height's error the throttle.
"""

import cmath
import math

import jsbsim

FRAMES_HZ = 120.0
"""Least rate of JSBSim's steps; at 60 Hz the motors' rates oscillate."""
CYCLE_S = 1.0 / 30.0
"""Longest cycle of the outer loops."""
GRAVITY_MPS2 = 9.81
M_PER_FT = 0.3048

VELOCITY_PER_S, WIND_PER_S2 = 1.8, 0.6
"""Acceleration for a velocity's error [1/s], and for its sum [1/s2], which takes up the wind."""
MOST_WIND_MPS2 = 4.0
MOST_TILT_RAD = 0.45
TILT_PER_S = 5.0
TURN_PER_S = 2.0
RATE_RADPS = 0.75
"""Rate that a full command of the aircraft's own loops asks for."""
CLIMB_PER_S, MOST_CLIMB_MPS = 1.0, 1.0
HOVER, THROTTLE_PER_MPS, THROTTLE_PER_M = 0.407, 0.15, 0.05
"""Throttle at rest, and for an error of the climb rate and of its sum."""
GROUND_M = 0.16
"""Height of the centre at which the landing gear touches the ground."""

NORTH_FT, EAST_FT, HEIGHT_FT = "position/from-start-neu-n-ft", "position/from-start-neu-e-ft", "position/h-agl-ft"
NORTH_FPS, EAST_FPS, DOWN_FPS = "velocities/v-north-fps", "velocities/v-east-fps", "velocities/v-down-fps"
ROLL, PITCH, YAW = "attitude/phi-rad", "attitude/theta-rad", "attitude/psi-rad"
WINDS = "atmosphere/wind-east-fps", "atmosphere/wind-north-fps", "atmosphere/wind-down-fps"
FRONT_RIGHT = "fcs/cmdFR_ext_nd"
"""Is added to the command of one motor."""


class _Silent(jsbsim.FGLogger):
    """JSBSim says of each F450 that its file is of another version, and that its sensors share names."""

    def set_level(self, level: jsbsim.LogLevel) -> None: ...
    def file_location(self, filename: str, line: int) -> None: ...
    def message(self, message: str) -> None: ...
    def format(self, format: jsbsim.LogFormat) -> None: ...
    def flush(self) -> None: ...


class Quadcopter:
    """A quadcopter that hovers at the start, its nose to the north (y). In the plane, numbers are x + iy."""

    def __init__(self, start_m: complex, height_m: float, cycle_s: float) -> None:
        jsbsim.set_logger(_Silent())
        self._frames = math.ceil(cycle_s * FRAMES_HZ - 1e-9)
        self._cycle_s = cycle_s
        self._start_m = self.place_m = start_m
        self._wanted_m = self.height_m = height_m
        self.velocity_mps = 0j
        self.roll_rad = self.pitch_rad = self.yaw_rad = 0.0
        self.crash = ""
        """How it crashed; empty: it flies."""
        self._against_wind_mps2 = 0j
        self._more_throttle = 0.0
        self._fdm = fdm = jsbsim.FGFDMExec(None)
        fdm.set_debug_level(0)
        fdm.load_model("F450")
        fdm.set_dt(cycle_s / self._frames)
        for name in ("terrain-elevation-ft", "psi-true-deg", "lat-geod-deg", "long-gc-deg"):
            fdm[f"ic/{name}"] = 0.0
        fdm["ic/h-sl-ft"] = height_m / M_PER_FT
        fdm.run_ic()
        fdm["fcs/ScasEngage"] = 1.0

    def fly(self, wanted_mps: complex, wind_mps: tuple[float, float, float], lost_rotor: bool) -> None:
        """Fly for a cycle in a wind, given by the air's velocity along x, y and down, and note where it is then."""
        fdm, cycle_s = self._fdm, self._cycle_s
        for name, component_mps in zip(WINDS, wind_mps, strict=True):
            fdm[name] = component_mps / M_PER_FT
        missing_mps = wanted_mps - self.velocity_mps
        self._against_wind_mps2 = _capped(self._against_wind_mps2 + WIND_PER_S2 * cycle_s * missing_mps, MOST_WIND_MPS2)
        push_mps2 = VELOCITY_PER_S * missing_mps + self._against_wind_mps2
        tilt = _capped(push_mps2 / GRAVITY_MPS2, MOST_TILT_RAD) * cmath.rect(1.0, self.yaw_rad - math.pi / 2)
        fdm["fcs/elevator-cmd-norm"] = _rate(TILT_PER_S * (-tilt.real - self.pitch_rad))
        fdm["fcs/aileron-cmd-norm"] = _rate(TILT_PER_S * (-tilt.imag - self.roll_rad))
        fdm["fcs/rudder-cmd-norm"] = _rate(-TURN_PER_S * self.yaw_rad)
        climb_mps = min(max(CLIMB_PER_S * (self._wanted_m - self.height_m), -MOST_CLIMB_MPS), MOST_CLIMB_MPS)
        missing_climb_mps = climb_mps + fdm[DOWN_FPS] * M_PER_FT
        self._more_throttle += THROTTLE_PER_M * cycle_s * missing_climb_mps
        upright = math.cos(self.roll_rad) * math.cos(self.pitch_rad)
        throttle = (HOVER + THROTTLE_PER_MPS * missing_climb_mps + self._more_throttle) / max(upright, 0.5)
        fdm["fcs/throttle-cmd-norm"] = min(max(throttle, 0.0), 1.0)
        fdm[FRONT_RIGHT] = -10.0 if lost_rotor else 0.0
        for _ in range(self._frames):
            fdm.run()
        self._look()

    def _look(self) -> None:
        fdm = self._fdm
        self.place_m = self._start_m + complex(fdm[EAST_FT], fdm[NORTH_FT]) * M_PER_FT
        self.velocity_mps = complex(fdm[EAST_FPS], fdm[NORTH_FPS]) * M_PER_FT
        self.height_m = fdm[HEIGHT_FT] * M_PER_FT
        self.roll_rad, self.pitch_rad = fdm[ROLL], fdm[PITCH]
        self.yaw_rad = math.remainder(fdm[YAW], math.tau)
        if math.cos(self.roll_rad) * math.cos(self.pitch_rad) < 0.0:
            self.crash = f"tumbled at {self.height_m:.1f} m"
        elif self.height_m < GROUND_M:
            speed_mps = math.hypot(abs(self.velocity_mps), fdm[DOWN_FPS] * M_PER_FT)
            self.crash = f"hit the ground at {speed_mps:.1f} m/s"


def _capped(number: complex, most: float) -> complex:
    """Return a vector of the plane, cut to a length with its direction kept."""
    return number if (size := abs(number)) <= most else number * (most / size)


def _rate(rate_radps: float) -> float:
    return min(max(rate_radps / RATE_RADPS, -1.0), 1.0)
