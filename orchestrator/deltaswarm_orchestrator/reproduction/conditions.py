"""Which runs the paper's results need, and how many of them are done."""

from dataclasses import dataclass

DECENTRALISED, HIERARCHICAL = "decentralised", "hierarchical"
HYBRID, HYBRID_2, HYBRID_4, HYBRID_10 = "hybrid 3", "hybrid 2", "hybrid 4", "hybrid 10"
DELTAS = tuple(f"hybrid {delta}" for delta in range(2, 11))
NO_RECRUITMENT, NO_DISSOLUTION = "no recruitment", "no dissolution"
LARGE = "100 agents, 200 I, 0.1 per s"
LARGE_READINGS = (
    LARGE,
    "100 agents, 200 I, 0.2 per s",
    "100 agents, 100 I, 0.1 per s",
    "100 agents, 100 I, 0.2 per s",
)
"""The scaled swarm with both readings of its covariance [m2] and of its rate."""

FIGURES: dict[int, tuple[str, ...]] = {
    1: (),
    2: (DECENTRALISED, HIERARCHICAL, HYBRID),
    3: (HYBRID, *LARGE_READINGS),
    4: (HYBRID, NO_RECRUITMENT, NO_DISSOLUTION, DECENTRALISED),
    5: (DECENTRALISED, HIERARCHICAL, *DELTAS),
}
"""The variants of the built-in sweep `paper` that each figure shows; figure 1 has runs of its own."""


@dataclass(frozen=True)
class Extent:
    """How much is run."""

    name: str
    repeats: int
    duration_s: float
    prove: int
    """Runs that real processes do too."""
    judges_convergence: bool
    """Whether runs are long enough to say where 100 agents converge to."""


FULL = Extent("full", 20, 9000.0, 4, judges_convergence=True)
QUICK = Extent("quick", 8, 3600.0, 2, judges_convergence=False)
