"""The task of the person at the station: to tell events that are targets from decoys.

The class of an event shows in nothing but how far the place jumps at which it is sensed. So all that the operator can
know of it comes from the places in reports.
"""

from dataclasses import dataclass

from deltaswarm_wire.checked import OURS, key

TARGET, DECOY = "target", "decoy"
CLASSES = (TARGET, DECOY)

GOAL = "Judge each event: target or decoy. A target stays where it is from report to report; a decoy seems to jump."


@dataclass(frozen=True)
class TaskSettings:
    """How many events are targets, how each class looks, and what the person is told."""

    target_share: float = key(
        0.0, "probability that an event is a target, else a decoy; 0: there is no task", source=OURS, low=0, high=0.99
    )
    target_jump_m: float = key(
        0.3,
        "standard deviation along x and y by which a target's sensed place is off [m]",
        source=OURS,
        low=0,
        high=100,
    )
    decoy_jump_m: float = key(2.0, "the same for a decoy [m]", source=OURS, low=0, high=100)
    jump_every_s: float = key(10.0, "interval after which the place is off by another error [s]", source=OURS, above=0)
    goal: str = key(GOAL, "what the page says of the task")

    @property
    def is_on(self) -> bool:
        """Whether events have classes, which the person judges."""
        return self.target_share > 0
