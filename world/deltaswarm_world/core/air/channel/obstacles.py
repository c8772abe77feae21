"""Obstacles to radio: they block or attenuate frames."""

from typing import Self

import numpy as np

from deltaswarm_world.core.air.channel.links import Diagnosis, Links, Mask
from deltaswarm_world.core.air.channel.model import Context
from deltaswarm_world.core.air.channel.reach import Reach
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.obstacles import Obstacles


class RadioObstacles:
    """A frame whose line of sight crosses obstacles loses the sum of their attenuations.

    An obstacle without an attenuation blocks. By power (log-distance), a frame is lost if less arrives than is
    needed. By a disc, a loss of L dB shortens the range by the factor 10^(-L / (10 exponent)): what the same
    loss does to the range under log-distance path loss with `path_loss.exponent`.
    """

    reason = "obstacle"
    meaning = "an obstacle blocks it or takes too much power"
    holds_for_step = True

    def __init__(self, obstacles: Obstacles, reach: Reach, exponent: float) -> None:
        self._obstacles = obstacles
        self._reach = reach
        self._exponent = exponent

    @classmethod
    def of(cls, context: Context) -> Self | None:
        """See `Model`."""
        obstacles = Obstacles(context.scenario.arena.obstacles)
        return cls(obstacles, context.reach, context.scenario.radio.path_loss.exponent) if obstacles else None

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        """See `Model`."""
        losses_db = self._losses_db(links)
        lossy = losses_db > 0
        if not lossy.any():
            return None
        factors: Floats = 10.0 ** (-losses_db / (10.0 * self._exponent))
        cut: Mask = lossy & (np.isinf(losses_db) | (self._reach.shares(links) > factors))
        return cut

    def _losses_db(self, links: Links) -> Floats:
        """Return losses, computed from the end with the lower number so that both directions round equally."""
        swapped = (links.senders > links.receivers)[:, None]
        from_m, to_m = np.where(swapped, links.to_m, links.from_m), np.where(swapped, links.from_m, links.to_m)
        return self._obstacles.attenuations_db(from_m, to_m)

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        """Return the obstacles on the line of sight, and their attenuation."""
        crossed = self._obstacles.crossed(links.from_m, links.to_m)
        if not crossed:
            return Diagnosis(self.reason, False, "no obstacle between them", {})
        loss_db = float(self._losses_db(links)[0])
        cuts = self.cuts(links, time_s)
        which = f"obstacle{'s' if len(crossed) > 1 else ''} {', '.join(map(str, crossed))}"
        if np.isinf(loss_db):
            return Diagnosis(self.reason, True, f"{which} in between, blocking", {"obstacles": crossed})
        says = f"{which} in between, {loss_db:g} dB"
        is_cut = cuts is not None and bool(cuts[0])
        return Diagnosis(self.reason, is_cut, says, {"obstacles": crossed, "attenuation_db": loss_db})
