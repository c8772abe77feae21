"""The three control structures of the paper, as what a free agent does under each."""

from dataclasses import dataclass

from deltaswarm_wire.settings import ControlSettings


@dataclass(frozen=True)
class Strategy:
    """What sets the modes apart; trees work the same in all of them.

    `founds_at` is the number of events sensed at once that makes a free agent a root (None: never).
    `attends` says whether free agents go to events, observe them and report.
    """

    founds_at: int | None
    attends: bool


def strategy_of(control: ControlSettings) -> Strategy:
    """The strategy of the scenario's mode.

    decentralised: the baseline, free agents attend, no trees. hierarchical: trees from rho events on, and
    free agents only walk. hybrid: below delta as decentralised, at delta an agent founds a tree.
    """
    return {
        "decentralised": Strategy(founds_at=None, attends=True),
        "hierarchical": Strategy(founds_at=control.rho, attends=False),
        "hybrid": Strategy(founds_at=control.delta, attends=True),
    }[control.mode]
