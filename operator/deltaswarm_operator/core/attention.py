"""What the person at the station reads, and how soon: the same measures as a simulated person's.

Pure. An item that is unread for longer than `operator.person.patience_s` is missed, even if it is read later.
"""

from collections.abc import Iterable
from typing import Any

from deltaswarm_operator.core.measures import Measures
from deltaswarm_operator.core.picture import Picture


class Attention:
    """Follows the items of one inbox. Times are simulated [s]; `wall_s` is any monotonic clock."""

    def __init__(self, patience_s: float) -> None:
        self.measures = Measures()
        self.shown_wall_s: list[float] = []
        """When each item was first shown, by its number."""
        self.read_at: dict[int, tuple[float, float]] = {}
        """When each item was read: simulated and wall time."""
        self._patience_s = patience_s
        self._judged = 0
        """Number of items whose time has passed."""

    def show(self, picture: Picture, wall_s: float) -> None:
        """Note that all items have been shown by now."""
        self.shown_wall_s += [wall_s] * (len(picture.inbox) - len(self.shown_wall_s))

    def read(self, picture: Picture, numbers: Iterable[int], wall_s: float) -> None:
        """Note that items were read."""
        for number in numbers:
            self.read_at[number] = (picture.now_s, wall_s)
            self.measures.read += 1
            self.measures.acknowledge_s += picture.now_s - picture.inbox[number].time_s

    def close_step(self, picture: Picture) -> None:
        """Count what is unread at the end of a step, and what has become too old."""
        self.measures.items = len(picture.inbox)
        self.measures.see_unread(len(picture.unread))
        oldest_s = picture.now_s - self._patience_s
        while self._judged < len(picture.inbox) and picture.inbox[self._judged].time_s < oldest_s:
            self.measures.missed += self._judged in picture.unread
            self._judged += 1

    def totals(self, picture: Picture, commands: int, isa: float | None) -> dict[str, Any]:
        """Return the metrics of the run so far, for JSON; what a person does inside is not known: None."""
        self.measures.commands = commands
        return {**self.measures.totals(len(picture.unread), isa), "load_above_0_7_s": None, "interaction_s": None}
