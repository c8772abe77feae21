"""The tables of a study file about single events: times until a moment (survival), and times by distance (rings)."""

from dataclasses import dataclass

from deltaswarm_wire.checked import key

MOMENT_DOC = "the moment, by the metric of its mean time: waiting_all, told_s, worked_s or completion_s"
HORIZON_DOC = "time for which events are followed [s]; default: metrics.horizon_s of the variants"


@dataclass(frozen=True)
class SurvivalSettings:
    """A table `[[survival]]`: the time from an event's arrival until a moment, by Kaplan and Meier."""

    text: str = key("", "what is shown, in a few words")
    metric: str = key("told_s", MOMENT_DOC)
    horizon_s: float | None = key(None, HORIZON_DOC, above=0)
    variants: tuple[str, ...] = key((), "show only these variants, in this order (default: all)")
    reference: str = key("", "compare the other variants with this one, replicate by replicate")


@dataclass(frozen=True)
class RingsSettings:
    """A table `[[rings]]`: the time until a moment by distance from the place where events are densest."""

    text: str = key("", "what is shown, in a few words")
    metric: str = key("told_s", MOMENT_DOC)
    rings: int = key(5, "number of rings, each with the same number of events", low=2, high=50)
    horizon_s: float | None = key(None, HORIZON_DOC, above=0)
    variants: tuple[str, ...] = key((), "show only these variants, in this order (default: all)")
