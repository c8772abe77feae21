"""The options of the paper's control structures, with the paper's values as defaults."""

from dataclasses import dataclass

from deltaswarm_agent.controllers.paper.policy import MAX_WEIGHT, WEIGHTS, shipped
from deltaswarm_wire.checked import OURS, PAPER, Problem, key
from deltaswarm_wire.settings import AgentSettings

ALL, NEAREST = "all", "nearest"
STAYS, LEAVES = "stays", "leaves"
WITH_EVENTS, ANY = "with-events", "any"
FIXED, BUSY, LEARNED, BANDIT = "fixed", "busy", "learned", "bandit"
PRICED = LEARNED, BANDIT
"""Rules by which a price of messages counts."""


@dataclass(frozen=True)
class PaperSettings:
    """How agents decide (Hybrid coordination)."""

    delta: int = key(3, "hybrid: events sensed at once that make an agent a root", source=PAPER, low=1, high=1000)
    rho: int = key(2, "hierarchical: events sensed at once that make an agent a root", source=PAPER, low=1, high=1000)
    recruitment: bool = key(True, "active recruitment; off is an ablation", source=PAPER)
    dissolution: bool = key(True, "dissolution; off is an ablation", source=PAPER)
    d_min_m: float = key(6.0, "minimum distance between members of a tree [m]", source=OURS, low=0)
    gamma_max: float = key(
        40.0,
        "dissolution parameter when an event is sensed: a member of level n leaves after 1/n of it [s]",
        source=OURS,
        low=1,
        high=1_000_000,
    )
    recruitment_interval_s: float = key(60.0, "interval at which a root recruits [s]", source=PAPER, above=0)
    recruitment_places: str = key(
        ANY,
        "where a root may send a leaf: where known events are sensed, or, if there are none, to any legal place",
        source=OURS,
        choices=(WITH_EVENTS, ANY),
    )
    idle_root: str = key(
        STAYS,
        "what a root without followers does once it has sensed nothing for gamma_max",
        source=OURS,
        choices=(STAYS, LEAVES),
    )
    root_succession: bool = key(
        False, "a member of level 1 takes the place of a root that has fallen silent", source=OURS
    )
    patience_finds: float = key(
        0.0,
        "an idle agent leaves its tree once a walker would have found this many events; 0: dissolution by gamma",
        source=OURS,
        low=0,
        high=1000,
    )
    return_to_finds: bool = key(False, "some legs of the walk lead back to where events were found", source=OURS)
    find_memory_s: float = key(1500.0, "time for which the place of a find is remembered [s]", source=OURS, above=0)
    delta_rule: str = key(
        FIXED,
        "hybrid: what sets delta: the key delta, or each agent: by how busy agents are, by a learned policy, or by "
        "what comes of its choices in the run",
        source=OURS,
        choices=(FIXED, BUSY, LEARNED, BANDIT),
    )
    policy: tuple[float, ...] = key(
        (),
        "learned: the policy's numbers; empty: those of the shipped one",
        source=OURS,
        low=-MAX_WEIGHT,
        high=MAX_WEIGHT,
    )
    message_price: float = key(
        1.0,
        "learned, bandit: delay of an event that one message to the operator is worth [s]",
        source=OURS,
        low=0,
        high=1000,
    )
    leg_max_s: float = key(
        100.0, "maximum duration of a leg of the walk; durations are uniform [s]", source=OURS, above=0
    )
    leg_exponent: float = key(
        0.0,
        "durations of legs follow a power law with this exponent, from 1 s on (a Levy walk: 1 to 3); 0: uniform",
        source=OURS,
        low=0,
        high=10,
    )
    member_observes: str = key(
        NEAREST,
        "events that a tree member works on at once: all it senses, or the nearest",
        source=OURS,
        choices=(ALL, NEAREST),
    )
    report_every_s: float = key(
        1.0, "interval of reports while there is something to report, at least one step [s]", source=PAPER, above=0
    )
    report_finds: bool = key(
        False, "a free agent reports an event once when it comes upon it, whether it goes there or not", source=OURS
    )
    report_members: bool = key(True, "a root's report names its followers, with parents and places", source=OURS)

    def __post_init__(self) -> None:
        if self.delta_rule == LEARNED and not self.policy:  # so that a run's scenario has the numbers
            object.__setattr__(self, "policy", shipped())

    def problems(self) -> list[Problem]:
        """A policy has as many numbers as the rule needs."""
        if len(self.policy) in (0, WEIGHTS):
            return []
        return [Problem("policy", f"{len(self.policy)} numbers", f"must be {WEIGHTS} numbers, or none")]

    def problems_with(self, shared: AgentSettings) -> list[Problem]:
        """Members of a tree must be able to hear each other."""
        if self.d_min_m < shared.range_m:
            return []
        return [Problem("d_min_m", f"{self.d_min_m:.15g}", f"must be below the radio's range, {shared.range_m:.15g} m")]
