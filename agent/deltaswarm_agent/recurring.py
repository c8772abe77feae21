"""Actions that a controller repeats at an interval in seconds, whatever the length of a step."""


class Recurring:
    """Says when something is due again, from `first_s` on: at most a step late, and without drift.

    With steps longer than `every_s` it occurs once a step.
    """

    def __init__(self, every_s: float, first_s: float = 0.0) -> None:
        self._every_s = every_s
        self._due_s = first_s

    def is_due(self, now_s: float) -> bool:
        """Return whether it is due, in which case it is next due `every_s` later."""
        if now_s < self._due_s - 1e-9:
            return False
        in_turn_s = self._due_s + self._every_s
        self._due_s = in_turn_s if in_turn_s > now_s + 1e-9 else now_s + self._every_s
        return True
