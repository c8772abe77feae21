"""Extensions of the world from outside: a radio model, a fault, and the entry points of a package that has both."""

import os
from pathlib import Path

import pytest

MODULE = '''
from dataclasses import dataclass

from deltaswarm_wire.checked import key
from deltaswarm_world.core.air.channel.links import Diagnosis
from deltaswarm_world.core.faults.kind import Kind


@dataclass(frozen=True)
class FogSettings:
    density: float = key(0.02, "share of frames lost per metre", low=0, high=1)
    until_s: float = key(1e6, "end of the fog [s]", low=0)


class Fog:
    """Loses frames the more the longer their way."""

    Settings = FogSettings
    reason = "fog"
    meaning = "fog on the way"
    holds_for_step = False

    def __init__(self, settings, rng):
        self.settings, self.rng = settings, rng

    @classmethod
    def of(cls, context):
        return cls(context.settings, context.rng())

    def cuts(self, links, time_s):
        draws = self.rng.random(len(links))
        return draws < self.settings.density * links.distances_m if time_s < self.settings.until_s else None

    def explain(self, links, time_s):
        share = min(1.0, self.settings.density * float(links.distances_m[0]))
        return Diagnosis(self.reason, share >= 1.0, f"fog takes {share:.0%}", {"share": share})


class Curtain:
    """Cuts every link; it has no options."""

    reason = "curtain"
    meaning = "a curtain is down"
    holds_for_step = True

    @classmethod
    def of(cls, context):
        return cls()

    def cuts(self, links, time_s):
        return links.distances_m >= 0

    def explain(self, links, time_s):
        return Diagnosis(self.reason, True, "the curtain is down", {})


class WrongReason(Fog):
    reason = "Dense fog"


@dataclass(frozen=True)
class WindSettings:
    speed_mps: float = key(0.2, "speed of the wind along x [m/s]", low=0, high=10)


class Wind(Kind):
    """The wind drives bodies along x."""

    Settings = WindSettings

    def look(self, faults):
        super().look(faults)
        self.winds = [(sorted(fault.agents), fault.settings.speed_mps) for fault in faults]

    def drive(self, velocities_mps):
        for agents, speed_mps in self.winds:
            velocities_mps[agents, 0] += speed_mps


class Squall(Wind):
    lasts = "duration_s is needed"
'''

POINTS = """
[deltaswarm.radio_models]
fog = weather:Fog
[deltaswarm.faults]
wind = weather:Wind
"""


def put_weather(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the extensions importable here and in new processes, as those of an installed package."""
    (folder / "weather.py").write_text(MODULE)
    package = folder / "weather-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: weather\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", f"{folder}:{os.environ.get('PYTHONPATH', '')}")
