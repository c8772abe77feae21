"""The pace of clock `realtime`: one step per tick of the wall clock. The clock and the waiting are the caller's."""

from collections.abc import Callable


class RealTimePace:
    """Keeps steps from ending before their tick is over; a step that takes longer is counted and not made up for.

    `monotonic` tells the wall time [s], as in the module `time`; `complain` gets a text once, when the pace is lost
    for the first time.
    """

    def __init__(
        self,
        tick_s: float,
        monotonic: Callable[[], float],
        complain: Callable[[str], None],
    ) -> None:
        self.overruns = 0
        """Steps that began more than a tick late because an earlier one took too long."""
        self._tick_s = tick_s
        self._monotonic = monotonic
        self._complain = complain
        self.tick_ends_s = monotonic()
        """The wall time at which the step's tick is over."""

    def next_tick(self) -> float:
        """Begin a step; the wall time [s] at which it must end.

        A delay of up to one tick shortens this step. After a longer one the ticks are counted from now, so that no
        burst of steps follows.
        """
        now_s = self._monotonic()
        if now_s > self.tick_ends_s + self._tick_s:
            self.overruns += 1
            if self.overruns == 1:
                self._complain(f"the machine cannot hold the pace of one step per {self._tick_s:g} s")
            self.tick_ends_s = now_s
        self.tick_ends_s += self._tick_s
        return self.tick_ends_s

    def pause(self, seconds: float) -> None:
        """Leave a stretch of time out of the count: nobody is late because of it."""
        self.tick_ends_s += seconds
