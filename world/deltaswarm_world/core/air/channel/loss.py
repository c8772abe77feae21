"""Random loss of frames: independent, in bursts, by contention, and on links that are worse than the others."""

from typing import Self

import numpy as np

from deltaswarm_scenario.radio import AsymmetrySettings, BurstSettings
from deltaswarm_world.core.air.channel.links import Diagnosis, LinkDraws, Links
from deltaswarm_world.core.air.channel.model import Context
from deltaswarm_world.core.air.channel.reach import Reach
from deltaswarm_world.core.arrays import Floats, Indices, Mask


class Loss:
    """Each frame is lost with the same probability, independently per receiver."""

    reason = "loss"
    meaning = "chance"
    holds_for_step = False
    stream = 3

    def __init__(self, share: float, rng: np.random.Generator) -> None:
        self._share = share
        self._rng = rng

    @classmethod
    def of(cls, context: Context) -> Self | None:
        share = context.scenario.radio.loss
        return cls(share, context.rng(cls.stream)) if share > 0 else None

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        lost: Mask = self._rng.random(len(links)) < self._share
        return lost

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        return Diagnosis(self.reason, False, f"loses {self._share:.0%} of frames, by chance", {"share": self._share})


class Bursts:
    """Gilbert-Elliott loss: each directed link is good or bad, and starts in the stationary distribution.

    A link's state is drawn only when a frame passes, in one draw by the chain's law for the steps since the last
    draw. All frames of one link in one step meet the same state.

    Args:
        settings: probabilities and losses.
        ends: number of ends that send or receive.
        step_s: length of a step [s].
        rng: the model's own generator.
        to_one: whether all links lead to the same end, as for reports; then states are per sender.
    """

    reason = "burst"
    meaning = "chance, on a link in its bad state"
    holds_for_step = False
    stream = 33

    def __init__(
        self, settings: BurstSettings, ends: int, step_s: float, rng: np.random.Generator, to_one: bool = False
    ) -> None:
        self._settings = settings
        self._step_s = step_s
        self._rng = rng
        change = settings.p_good_to_bad + settings.p_bad_to_good
        self._stationary = settings.p_good_to_bad / change if change > 0 else 0.0
        self._memory = 1.0 - change
        self._ends = ends
        self._to_one = to_one
        links = ends if to_one else ends * ends
        self._badness = np.full(links, self._stationary)
        """1 if a link was bad at its last draw, 0 if good; in between before the first draw."""
        self._drawn_at = np.zeros(links, dtype=np.int32)
        """Step of the last draw, counted from 1; 0: never."""

    @classmethod
    def of(cls, context: Context) -> Self | None:
        settings = context.scenario.radio.burst
        return cls(settings, context.ends, context.step_s, context.rng(cls.stream)) if settings.is_on else None

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        settings, places = self._settings, self._places(links)
        draws: Floats = self._rng.random((2, len(links)))
        now = self._now(time_s)
        is_bad = draws[0] < self._p_bad(places, now)
        if links.has_twins:
            is_bad = is_bad[_first_of_each(places)]
        self._badness[places] = is_bad
        self._drawn_at[places] = now
        lost: Mask = draws[1] < np.where(is_bad, settings.loss_bad, settings.loss_good)
        return lost

    def p_bad(self, links: Links, time_s: float) -> Floats:
        """Return the probability of being bad now, given the last draw."""
        return self._p_bad(self._places(links), self._now(time_s))

    def _p_bad(self, places: Indices, now: int) -> Floats:
        memory = np.power(self._memory, now - self._drawn_at[places])
        p_bad: Floats = self._stationary + (self._badness[places] - self._stationary) * memory
        return p_bad

    def _places(self, links: Links) -> Indices:
        places: Indices = links.senders if self._to_one else links.senders * self._ends + links.receivers
        return places

    def _now(self, time_s: float) -> int:
        return round(time_s / self._step_s) + 1

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        place = self._places(links)[0]
        p_bad = float(self.p_bad(links, time_s)[0])
        if self._drawn_at[place] == self._now(time_s):
            is_bad = bool(self._badness[place])
            share = self._settings.loss_bad if is_bad else self._settings.loss_good
            says = f"the link is {'bad' if is_bad else 'good'} and loses {share:.0%} of frames"
            return Diagnosis(self.reason, False, says, {"bad": is_bad, "share": share})
        return Diagnosis(self.reason, False, f"the link is bad with a chance of {p_bad:.0%}", {"p_bad": p_bad})


def _first_of_each(places: Indices) -> Indices:
    """Return for each row the first row of the same link; rows of a link are adjacent."""
    is_new = np.ones(len(places), dtype=np.bool_)
    is_new[1:] = places[1:] != places[:-1]
    firsts: Indices = np.flatnonzero(is_new)[np.cumsum(is_new) - 1]
    return firsts


class Contention:
    """A receiver in reach of more bytes per step than the medium carries receives a random part of the frames.

    Frames are taken in random order; the first that does not fit, and all after it, are lost.
    """

    reason = "contention"
    meaning = "there were too many bytes on the air around the receiver"
    holds_for_step = False
    stream = 34

    def __init__(self, bytes_per_step: float, rng: np.random.Generator) -> None:
        self._bytes_per_step = bytes_per_step
        self._rng = rng

    @classmethod
    def of(cls, context: Context) -> Self | None:
        bytes_per_step = context.scenario.radio.contention_bytes_per_s * context.step_s
        return cls(bytes_per_step, context.rng(cls.stream)) if bytes_per_step > 0 else None

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        """See `Model`. Frames cut by other models take no capacity."""
        order = self._rng.random(len(links))
        if not len(links):
            return None
        receivers = links.receivers
        loads = np.bincount(receivers, weights=links.sizes * links.is_open)
        is_full = loads > self._bytes_per_step
        contending = (is_full[receivers] & links.is_open).nonzero()[0]
        if not len(contending):
            return None
        contending = contending[np.lexsort((order[contending], receivers[contending]))]
        loads *= is_full
        before = np.cumsum(loads) - loads  # of receivers before
        cut: Mask = np.zeros(len(links), dtype=np.bool_)
        cut[contending] = np.cumsum(links.sizes[contending]) - before[receivers[contending]] > self._bytes_per_step
        return cut

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        most = self._bytes_per_step
        says = f"a receiver hears at most {most:g} bytes in a step"
        return Diagnosis(self.reason, False, says, {"bytes_per_step": most})


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
        factors = self.factors(links)
        if self._settings.range_factor_low >= 1.0:
            return factors < 0.0
        return self._reach.shares(links) > factors

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        factor, share = float(self.factors(links)[0]), float(self._reach.shares(links)[0])
        if factor < 0.0:
            return Diagnosis(self.reason, True, "this direction carries nothing", {"dead": True})
        cuts = share > factor and self._settings.range_factor_low < 1.0
        says = f"this direction has {factor:.2f} of its range and needs {share:.2f}"
        return Diagnosis(self.reason, cuts, says, {"range_factor": factor, "range_share": share})
