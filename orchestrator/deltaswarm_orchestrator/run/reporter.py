"""Who is told how a run goes. Apart from `progress.py`, which takes rich: a sweep's worker shows nothing."""

from typing import Protocol

from deltaswarm_wire.operator_messages import Status


class Reporter(Protocol):
    """Who is told how a run goes."""

    def update(self, status: Status, messages_per_s: float | None) -> None:
        """The newest state."""

    def say(self, text: str) -> None:
        """Something that the user has to do."""


class Quiet:
    """Tells nobody."""

    def update(self, status: Status, messages_per_s: float | None) -> None:
        """Nothing."""

    def say(self, text: str) -> None:
        """Nothing."""
