"""Links that are worse than the others."""

from typing import Self

import numpy as np

from deltaswarm_scenario.radio import AsymmetrySettings
from deltaswarm_world.core.air.channel.links import Diagnosis, LinkDraws, Links, Mask
from deltaswarm_world.core.air.channel.model import Context
from deltaswarm_world.core.air.channel.reach import Reach
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.near import Indices

MOST_IN_TABLE = 1000
"""Up to this number of ends, a link's draw is cached (8 MB); beyond, it is repeated when needed."""


class Asymmetry:
    """Some directed links carry nothing, others have a reduced range, constant for a whole run."""

    reason = "asymmetry"
    meaning = "this direction of the link is worse"
    holds_for_step = True
    stream = 32

    def __init__(self, settings: AsymmetrySettings, reach: Reach, ends: int, rng: np.random.Generator) -> None:
        self._settings = settings
        self._reach = reach
        self._factor_draws, self._death_draws = LinkDraws(rng), LinkDraws(rng)
        self._table: Floats | None = None
        if ends <= MOST_IN_TABLE:
            ids = np.arange(ends)
            self._table = self._drawn(np.repeat(ids, ends), np.tile(ids, ends)).reshape(ends, ends)

    @classmethod
    def of(cls, context: Context) -> Self | None:
        """See `Model`."""
        settings = context.scenario.radio.asymmetry
        if settings.dead_share == 0 and settings.range_factor_low == 1:
            return None
        return cls(settings, context.reach, context.ends, context.rng(cls.stream))

    def factors(self, links: Links) -> Floats:
        """Return the factor of each link's range; negative for a dead link."""
        if self._table is None:
            return self._drawn(links.senders, links.receivers)
        factors: Floats = self._table[links.senders, links.receivers]
        return factors

    def _drawn(self, senders: Indices, receivers: Indices) -> Floats:
        low, draws, deaths = self._settings.range_factor_low, self._factor_draws, self._death_draws
        factors: Floats = low + (1.0 - low) * draws.uniform(draws.ends(senders), draws.ends(receivers))
        is_dead = deaths.uniform(deaths.ends(senders), deaths.ends(receivers)) < self._settings.dead_share
        factors[is_dead] = -1.0
        return factors

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        """See `Model`."""
        factors = self.factors(links)
        if self._settings.range_factor_low >= 1.0:
            return factors < 0.0
        return self._reach.shares(links) > factors

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        """Explain with the link's factor."""
        factor, share = float(self.factors(links)[0]), float(self._reach.shares(links)[0])
        if factor < 0.0:
            return Diagnosis(self.reason, True, "this direction carries nothing", {"dead": True})
        cuts = share > factor and self._settings.range_factor_low < 1.0
        says = f"this direction has {factor:.2f} of its range and needs {share:.2f}"
        return Diagnosis(self.reason, cuts, says, {"range_factor": factor, "range_share": share})
