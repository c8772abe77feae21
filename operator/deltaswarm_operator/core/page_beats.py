"""Whether a page of the participant answers, and for how long none did: each page beats once a second.

Pure. `wall_s` is any monotonic clock, such as `time.monotonic`.
"""

import math

QUIET_AFTER_S = 1.5
"""A page that beats has been heard within this time [wall s]."""
AWAY_AFTER_S = 3.0
"""A page that has said nothing for longer than this is away [wall s]."""


class PageBeats:
    """The beats of all pages of one participant, and the time without any."""

    def __init__(self) -> None:
        self.is_there = False
        """Whether a page answers; False before the first one is opened."""
        self.is_away = False
        """Whether it was noted that no page answers."""
        self.rtt_s = 0.0
        """How long a message to the page and its answer take, as the page says [s]."""
        self.heard_wall_s = math.inf
        """When a page was last heard; inf: nobody listens yet."""
        self._began_wall_s: float | None = None
        self._closed_wall_s = 0.0
        self._away_s = 0.0

    def start(self, wall_s: float) -> None:
        """Begin to listen; earlier silence does not count."""
        self.heard_wall_s = wall_s

    def beat(self, wall_s: float) -> float | None:
        """Take a sign of life; return how long there was none, if that was noted [wall s]."""
        since_wall_s, self.heard_wall_s, self.is_there = self.heard_wall_s, wall_s, True
        if not self.is_away:
            return None
        self.is_away = False
        self._away_s += self._within_run_s(since_wall_s, wall_s)
        return wall_s - since_wall_s

    def check(self, wall_s: float) -> float | None:
        """Return since when no page answers, if that is new [wall s]."""
        if self.is_away or not self.is_silent(wall_s):
            return None
        self.is_there, self.is_away = False, True
        return self.heard_wall_s

    def is_silent(self, wall_s: float) -> bool:
        """Whether nothing was heard for so long that no page is there."""
        return wall_s - self.heard_wall_s > AWAY_AFTER_S + self.rtt_s

    def close_step(self, wall_s: float) -> None:
        """Note that a step of the run was closed; the time counts from the first to the last of them."""
        if self._began_wall_s is None:
            self._began_wall_s = wall_s
        self._closed_wall_s = wall_s

    @property
    def away_s(self) -> float:
        """The wall time of the run so far in which no page answered [s]."""
        open_s = self._within_run_s(self.heard_wall_s, self._closed_wall_s) if self.is_away else 0.0
        return round(self._away_s + open_s, 3)

    def _within_run_s(self, since_wall_s: float, until_wall_s: float) -> float:
        return 0.0 if self._began_wall_s is None else max(0.0, until_wall_s - max(since_wall_s, self._began_wall_s))
