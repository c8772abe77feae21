"""The interface for a run's progress. Separate from `progress.py`, which imports rich: sweep workers show nothing."""

from deltaswarm_wire.operator_messages import Status


class Reporter:
    """Takes the progress of a run. This base class discards it."""

    def update(self, status: Status, messages_per_s: float | None) -> None:
        """Take the newest state."""

    def say(self, text: str) -> None:
        """Take a message for the user."""
