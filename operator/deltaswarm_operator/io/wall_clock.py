"""The wall clock of a console: one that can stand still, and go on where that of a killed process stopped."""

import time
from datetime import UTC, datetime, timedelta


class WallClock:
    """Tells the wall time [s] as `time.monotonic` does, and which moment of the calendar it was.

    A process that goes on with a run of another one, maybe on another machine, sets `ahead_s`. While `moment_s` is set,
    time stands still: all that one input causes happens in one moment, and so can be repeated.
    """

    def __init__(self) -> None:
        self.ahead_s = 0.0
        """By how much the clock is ahead of this machine's."""
        self.moment_s: float | None = None
        """Where it stands still; None: it runs."""

    def now(self) -> float:
        return time.monotonic() + self.ahead_s if self.moment_s is None else self.moment_s

    def utc_of(self, wall_s: float | None) -> str:
        """Return a moment of this clock in ISO 8601 to the millisecond; "" for None."""
        if wall_s is None:
            return ""
        moment = datetime.now(UTC) - timedelta(seconds=time.monotonic() + self.ahead_s - wall_s)
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
