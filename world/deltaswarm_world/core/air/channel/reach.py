"""Reach of a frame: a disc, or path loss with shadowing."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from deltaswarm_scenario.radio import LOG_DISTANCE, PathLossSettings, RadioSettings
from deltaswarm_world.core.air.channel.links import Diagnosis, Ends, Hashes, LinkDraws, Links
from deltaswarm_world.core.arrays import Floats, Indices, near, near_with_squares

SHADOWING_CUT = 4.0
"""Shadowing is cut at this number of standard deviations, which bounds reach; fewer than 1 link in 15,000 is beyond."""


class Found(NamedTuple):
    """Pairs in reach: rows of listeners, rows of speakers, and spare power if reach is by power."""

    rows: Indices
    columns: Indices
    spare_db: Floats | None = None


def ranges_of(settings: RadioSettings, count: int) -> Floats | None:
    """Each agent's range [m]; None if all ranges are equal."""
    if not settings.ranges:
        return None
    ranges_m = np.full(count, settings.range_m)
    for entry in settings.ranges:
        ranges_m[list(entry.agents)] = entry.range_m
    return ranges_m


class RangeDisc:
    """Reach up to and including the sender's range."""

    def __init__(self, range_m: float, ranges_m: Floats | None = None) -> None:
        self._range_m = range_m if ranges_m is None else float(ranges_m.max())
        self._ranges_m = ranges_m

    def find(self, listeners: Ends, speakers: Ends) -> Found:
        """Return all pairs in reach, senders with themselves included."""
        rows, columns = near(listeners.places_m, speakers.places_m, self._range_m)
        if self._ranges_m is None:
            return Found(rows, columns)
        offsets = listeners.places_m[rows] - speakers.places_m[columns]
        within = (offsets * offsets).sum(axis=1) <= self._ranges_m[speakers.ids[columns]] ** 2
        return Found(rows[within], columns[within])

    def shares(self, links: Links) -> Floats:
        """Return the share of its range that each link needs: distance divided by range."""
        return links.distances_m / self._of(links.senders)

    def _of(self, senders: Indices) -> Floats:
        return np.full(len(senders), self._range_m) if self._ranges_m is None else self._ranges_m[senders]

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        distance_m, range_m = float(links.distances_m[0]), float(self._of(links.senders)[0])
        offset = links.to_m[0] - links.from_m[0]
        cuts = not bool(offset[0] * offset[0] + offset[1] * offset[1] <= range_m**2)
        numbers = {"distance_m": distance_m, "range_m": range_m}
        return Diagnosis("range", cuts, f"distance {distance_m:.2f} m, range {range_m:g} m", numbers)


class PathLoss:
    """Reach by received power: log-distance path loss with shadowing per link.

    A sender's own range is a gain of 10 exponent log10(own range / range_m) dB. Distances below 1 m count as 1 m.
    Shadowing has no state: it follows from the link and, with decorrelation, from the grid squares of its ends, so a
    link that returns to the same squares has the same shadowing.
    """

    def __init__(
        self, settings: PathLossSettings, gains_db: Floats | None = None, draws: LinkDraws | None = None
    ) -> None:
        self._settings = settings
        self._gains_db = gains_db
        self._draws = draws if settings.shadowing_db > 0 else None
        spare_db = settings.tx_power_dbm - settings.reference_loss_db - settings.sensitivity_dbm
        if gains_db is not None:
            spare_db += max(0.0, float(gains_db.max()))
        if self._draws is not None:
            spare_db += SHADOWING_CUT * settings.shadowing_db
        self._bound_m = 1.000001 * max(1.0, self.distance_at_m(spare_db))

    def distance_at_m(self, spare_db: float) -> float:
        """Return the reach of this power above the requirement at 1 m [m]."""
        return float(10.0 ** min(300.0, spare_db / (10.0 * self._settings.exponent)))

    def find(self, listeners: Ends, speakers: Ends) -> Found:
        """Return all pairs in reach, senders with themselves included."""
        rows, columns, squares_m2 = near_with_squares(listeners.places_m, speakers.places_m, self._bound_m)
        power_dbm = self._settings.tx_power_dbm - self.loss_db(np.sqrt(squares_m2))
        if self._draws is not None:
            ends = self._numbers(self._draws, listeners, speakers)
            speak, hear = ends[columns + len(listeners.ids)], ends[rows]
            power_dbm += self._shadows_db[self._draws.pick(speak, hear, self._settings.shadowing_symmetric)]
        if self._gains_db is not None:
            power_dbm += self._gains_db[speakers.ids][columns]
        within = (power_dbm >= self._settings.sensitivity_dbm).nonzero()[0]
        return Found(rows[within], columns[within], power_dbm[within] - self._settings.sensitivity_dbm)

    def loss_db(self, distances_m: Floats) -> Floats:
        """Return path loss without shadowing [dB]."""
        settings = self._settings
        decades: Floats = np.log10(np.maximum(distances_m, 1.0))
        return settings.reference_loss_db + 10.0 * settings.exponent * decades

    def shadowing_db(self, links: Links) -> Floats:
        """Return the shadowing of each link: the change of its received power [dB]."""
        if self._draws is None:
            return np.zeros(len(links))
        speak = self._numbers(self._draws, Ends(links.senders, links.from_m))
        hear = self._numbers(self._draws, Ends(links.receivers, links.to_m))
        return self._shadows_db[self._draws.pick(speak, hear, self._settings.shadowing_symmetric)]

    @cached_property
    def _shadows_db(self) -> Floats:
        """All possible shadowing values; each link has one [dB]."""
        assert self._draws is not None
        return self._settings.shadowing_db * np.clip(self._draws.normals, -SHADOWING_CUT, SHADOWING_CUT)

    def _numbers(self, draws: LinkDraws, *sides: Ends) -> Hashes:
        """Return the inputs of a link's shadowing for each end: its id and its grid square."""
        ids = np.concatenate([side.ids for side in sides])
        side_m = self._settings.decorrelation_m
        if side_m <= 0:
            return draws.ends(ids)
        squares = np.floor(np.concatenate([side.places_m for side in sides]) / side_m).astype(np.int64)
        return draws.ends(ids, squares[:, 0] * (1 << 24) + squares[:, 1])

    def received_dbm(self, links: Links) -> Floats:
        power_dbm = self._settings.tx_power_dbm - self.loss_db(links.distances_m) + self.shadowing_db(links)
        return power_dbm if self._gains_db is None else power_dbm + self._gains_db[links.senders]

    def shares(self, links: Links) -> Floats:
        """Return the factor by which each link's range may shrink: the share of its range that it needs."""
        spare_db = links.spare_db
        if spare_db is None:
            spare_db = self.received_dbm(links) - self._settings.sensitivity_dbm
        shares: Floats = 10.0 ** (-spare_db / (10.0 * self._settings.exponent))
        return shares

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        distance_m, power_dbm = float(links.distances_m[0]), float(self.received_dbm(links)[0])
        loss_db, shadowing_db = float(self.loss_db(links.distances_m)[0]), float(self.shadowing_db(links)[0])
        needed_dbm = self._settings.sensitivity_dbm
        says = (
            f"distance {distance_m:.2f} m, path loss {loss_db:.1f} dB, shadowing {shadowing_db:+.1f} dB, received "
            f"{power_dbm:.1f} dBm, needed {needed_dbm:g} dBm"
        )
        numbers = {
            "distance_m": distance_m,
            "path_loss_db": loss_db,
            "shadowing_db": shadowing_db,
            "received_dbm": power_dbm,
            "sensitivity_dbm": needed_dbm,
        }
        return Diagnosis("range", power_dbm < needed_dbm, says, numbers)


Reach = RangeDisc | PathLoss
"""Reach by distance or power alone."""


def reach_of(settings: RadioSettings, count: int, rng: np.random.Generator) -> Reach:
    ranges_m = ranges_of(settings, count)
    if settings.reception != LOG_DISTANCE:
        return RangeDisc(settings.range_m, ranges_m)
    gains_db = None
    if ranges_m is not None:
        gains_db = 10.0 * settings.path_loss.exponent * np.log10(ranges_m / settings.range_m)
    return PathLoss(settings.path_loss, gains_db, LinkDraws(rng))
