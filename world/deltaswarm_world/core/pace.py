"""The pace of clock `realtime`: one step per tick of the wall clock. The caller has the clock and waits."""

from collections.abc import Callable


class RealTimePace:
    """Holds each step until the end of its tick; a longer step is counted, not made up for.

    `monotonic` returns the wall time [s], as in the module `time`; `complain` gets a text when the pace is first lost.
    """

    def __init__(
        self,
        tick_s: float,
        monotonic: Callable[[], float],
        complain: Callable[[str], None],
    ) -> None:
        self.overruns = 0
        """Steps that began more than one tick late."""
        self._tick_s = tick_s
        self._monotonic = monotonic
        self._complain = complain
        self.tick_ends_s = monotonic()
        """The wall time at which the step's tick ends."""

    def next_tick(self) -> float:
        """Begin a step; return the wall time [s] at which it must end.

        A delay of up to one tick shortens this step. After a longer delay ticks count from now, to avoid a burst of
        steps.
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
        """Exclude a pause from the pace."""
        self.tick_ends_s += seconds
