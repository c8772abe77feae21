"""The experiments: a limit of the network or a fault each, in steps from none to hard, for three control modes."""

from collections.abc import Sequence
from dataclasses import dataclass

from deltaswarm_orchestrator.reproduction.conditions import DECENTRALISED, HIERARCHICAL, HYBRID

MODES = (DECENTRALISED, HIERARCHICAL, HYBRID)
"""The control modes compared, by their labels in the sweeps."""

PAIRS = ((HYBRID, DECENTRALISED), (HYBRID, HIERARCHICAL), (HIERARCHICAL, DECENTRALISED))
"""Which modes are compared with which."""

LOSS = "network-loss"
LOSS_BAR, LOSS_BAR_LEVEL = 1.5, 0.3
"""Hybrid 3 shall wait at most so many times as long with this share of the frames lost as with none."""


@dataclass(frozen=True)
class Level:
    """One step of a limit."""

    label: str
    """Of the sweep's variants, before the mode."""
    value: float
    """On the figures' axis."""
    words: str
    """In a sentence: "waits twice as long <words>"."""
    is_beside: bool = False
    """Whether it is only shown beside: no harder limit than the one before."""


@dataclass(frozen=True)
class Fault:
    """When the limit is there, in experiments in which it comes and perhaps goes."""

    from_s: float
    until_s: float | None = None
    """None if it stays, as death does."""

    @property
    def over_s(self) -> float:
        """From when on a swarm can come back [s]: the end of what ends, the beginning of what stays."""
        return self.from_s if self.until_s is None else self.until_s


@dataclass(frozen=True)
class Experiment:
    """A built-in sweep, and what it means."""

    name: str
    """The sweep's."""
    title: str
    what: str
    """What is limited, and how, in a sentence or two."""
    axis: str
    """Label of the levels' axis, with the unit; empty where two levels make no axis."""
    levels: Sequence[Level]
    """Without the limit, then harder and harder; last those that stand beside."""
    fault: Fault | None = None

    @property
    def base(self) -> Level:
        """Without the limit."""
        return self.levels[0]

    @property
    def harder(self) -> list[Level]:
        """With it, from the mildest to the hardest."""
        return [level for level in self.levels[1:] if not level.is_beside]

    @property
    def hardest(self) -> Level:
        """The last of them."""
        return self.harder[-1]

    def level(self, label: str) -> Level:
        """The level of that label."""
        return next(level for level in self.levels if level.label == label)


_ZONE = Fault(3000.0, 6000.0)
_DEATH = Fault(4500.0)

_ALL = (
    Experiment(
        LOSS,
        "Loss",
        "Each frame in range is lost with this probability, independently.",
        "frames lost [share]",
        (
            Level("loss=0.0", 0.0, "without loss"),
            Level("loss=0.1", 0.1, "with 10 % of the frames lost"),
            Level("loss=0.3", 0.3, "with 30 % of the frames lost"),
            Level("loss=0.5", 0.5, "with 50 % of the frames lost"),
            Level("loss=0.9", 0.9, "with 90 % of the frames lost"),
        ),
    ),
    Experiment(
        "network-range",
        "Range",
        "How far a radio carries. Without the limit it is 9 m; members of a tree stand at least 6 m apart. 15 m is "
        "shown beside, to see whether more range than that helps.",
        "radio range [m]",
        (
            Level("range_m=9.0", 9.0, "with a range of 9 m"),
            Level("range_m=7.5", 7.5, "with a range of 7.5 m"),
            Level("range_m=6.5", 6.5, "with a range of 6.5 m"),
            Level("range_m=15.0", 15.0, "with a range of 15 m", is_beside=True),
        ),
    ),
    Experiment(
        "network-latency",
        "Latency",
        "Each frame is late by this, beside the one step that every hop takes, and by up to half as much again at "
        "random, so that frames overtake each other.",
        "least delay [s]",
        (
            Level("0 s", 0.0, "without delay"),
            Level("1 s", 1.0, "with frames 1 to 1.5 s late"),
            Level("2 s", 2.0, "with frames 2 to 3 s late"),
            Level("5 s", 5.0, "with frames 5 to 7.5 s late"),
        ),
    ),
    Experiment(
        "network-bandwidth",
        "Bandwidth",
        "How many bytes per second an agent's radio can send; 2000 bytes may wait, the rest is dropped. A free agent "
        "sends frames of about 20 bytes, a member of a tree with what it passes on 100 to 200.",
        "time to send a byte [ms]",
        (
            Level("sender_bytes_per_s=0.0", 0.0, "with unlimited bandwidth"),
            Level("sender_bytes_per_s=50.0", 20.0, "with 50 bytes per s"),
            Level("sender_bytes_per_s=20.0", 50.0, "with 20 bytes per s"),
        ),
    ),
    Experiment(
        "jamming",
        "Jamming",
        "From 3000 to 6000 s nobody hears anything within a circle around the place where events are densest. "
        "95 % of the events are within 17 m of it. Figures are of these 50 minutes.",
        "radius of the jammed circle [m]",
        (
            Level("no jammer", 0.0, "without a jammer"),
            Level("10 m", 10.0, "with 10 m around the centre jammed"),
            Level("20 m", 20.0, "with 20 m around the centre jammed"),
        ),
        _ZONE,
    ),
    Experiment(
        "partition",
        "Partition",
        "From 3000 to 6000 s a wall through the middle of the arena lets no frame pass; agents move through it. "
        "Figures are of these 50 minutes.",
        "",
        (
            Level("no wall", 0.0, "without a wall"),
            Level("halves", 1.0, "with the arena in halves"),
        ),
        _ZONE,
    ),
    Experiment(
        "uplink-outage",
        "Uplink outage",
        "From 3000 to 6000 s nothing reaches the operator; agents hear each other as before. Figures are of these 50 "
        "minutes.",
        "",
        (
            Level("no outage", 0.0, "without an outage"),
            Level("outage", 1.0, "with an outage of 50 minutes"),
        ),
        _ZONE,
    ),
    Experiment(
        "lose-a-third",
        "A third of the agents lost",
        "At 4500 s 8 of the 25 agents are killed, chosen at random. Beside it stand swarms that had 17 agents from "
        "the beginning. Figures are of what comes after 4500 s.",
        "",
        (
            Level("none lost", 0.0, "with all agents"),
            Level("a third lost", 1.0, "after a third of the agents is lost"),
            Level("17 from the beginning", 2.0, "with 17 agents from the beginning", is_beside=True),
        ),
        _DEATH,
    ),
    Experiment(
        "lose-the-roots",
        "All roots lost",
        "Whoever is a root at 4500 s is killed. A decentralised swarm has no roots, so it loses nobody: it is the "
        "measure of what two runs differ by when nothing happened. Figures are of what comes after 4500 s.",
        "",
        (
            Level("none lost", 0.0, "with all agents"),
            Level("roots lost", 1.0, "after all roots are lost"),
        ),
        _DEATH,
    ),
)

EXPERIMENTS = {experiment.name: experiment for experiment in _ALL}
"""By name, in the page's order."""
