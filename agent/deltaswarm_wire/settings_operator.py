"""What the operator is told of a run: how workload is measured, the area, the commands, the probes; never the truth."""

from dataclasses import dataclass

from deltaswarm_wire.checked import key
from deltaswarm_wire.commands import CommandForm
from deltaswarm_wire.settings_downlink import CommandSettings
from deltaswarm_wire.settings_obstacles import ObstacleSettings
from deltaswarm_wire.settings_radio import Place

OURS = "our reading"


@dataclass(frozen=True)
class ProbeSettings:
    """What a person at the station is asked."""

    isa_every_s: float = key(
        120.0, "simulated time between ISA questions (workload from 1 to 5); 0: none [s]", low=0, high=1e6
    )
    isa_jitter_s: float = key(0.0, "more time before each, uniform from 0 to this [s]", low=0, high=1e6)
    isa_wait_s: float = key(30.0, "wall time after which an ISA question counts as missing [s]", above=0, high=3600)
    tlx: bool = key(False, "ask NASA-TLX at the end: six scales from 0 to 100")
    tlx_weights: bool = key(False, "ask for the 15 pairwise weights of NASA-TLX too")
    consent: str = key("", "a text that a participant must agree to before the run begins")


@dataclass(frozen=True)
class OperatorSettings:
    """How the workload is measured, and who the operator is."""

    threshold_hz: float = key(5.0, "time above this message rate is counted (sliding 60 s)", low=0)
    more_thresholds_hz: tuple[float, ...] = key((), "further thresholds that the station shows", low=0)
    probes: ProbeSettings = key(ProbeSettings, "what a person at the station is asked")


@dataclass(frozen=True)
class Briefing:
    """All that the operator is told before a run in which somebody commands or watches."""

    title: str = key("", "what the station calls the run")
    seed: int = key(0, "for the operator's own chance", low=0)
    duration_s: float = key(0.0, "simulated time of the run [s]")
    step_s: float = key(1.0, "length of a step [s]")
    width_m: float = key(100.0, "arena along x [m]")
    height_m: float = key(100.0, "arena along y [m]")
    obstacles: tuple[ObstacleSettings, ...] = key((), "what bodies do not enter")
    base_m: Place | None = key(None, "where the operator's base is [m]", length=2)
    range_m: float | None = key(None, "reports are heard up to here from the base [m]")
    agents: int = key(1, "number of agents")
    operator: OperatorSettings = key(OperatorSettings, "how workload is measured")
    forms: tuple[CommandForm, ...] = key((), "the commands that the controller accepts")
    command: tuple[CommandSettings, ...] = key((), "what a scripted operator commands")
    speed: float = key(1.0, "simulated per wall second to begin with; 0: as fast as possible", low=0)

    @property
    def is_awaited(self) -> bool:
        """Whether each step waits for the operator's turn."""
        return bool(self.command)
