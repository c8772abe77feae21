"""Hybrid coordination (the paper's section of that name).

An agent that senses fewer than delta events acts as a decentralised swarm does: it goes to one and observes it
(`baseline.py`). One that senses delta events or more founds a tree where it stands (`root_formation.py`), as a
hierarchical swarm does at rho. So delta sets how much of the swarm is centralised.
"""

from dataclasses import dataclass

from deltaswarm_agent.controllers.paper.settings import FIXED, PaperSettings


@dataclass(frozen=True)
class Strategy:
    """The difference between the modes; trees are equal in all of them.

    `founds_at` is the number of events sensed at once that makes a free agent a root (None: never).
    `attends` says whether free agents go to events, observe them and report. `has_delta`: the operator may change
    `founds_at`. `rule`: what else does (`delta.py`, `policy.py`).
    """

    founds_at: int | None
    attends: bool
    has_delta: bool = False
    rule: str = FIXED


def strategy_of(mode: str, control: PaperSettings) -> Strategy:
    """Return the strategy of a mode.

    decentralised: the baseline, free agents attend, no trees. hierarchical: trees from rho events on, and
    free agents only walk. hybrid, and any other name: below delta as decentralised, at delta an agent founds a tree.
    """
    if mode == "decentralised":
        return Strategy(founds_at=None, attends=True)
    if mode == "hierarchical":
        return Strategy(founds_at=control.rho, attends=False)
    return Strategy(founds_at=control.delta, attends=True, has_delta=True, rule=control.delta_rule)
