"""Who is told how a run goes. Apart from `progress.py`, which takes rich: a sweep's worker shows nothing."""

from deltaswarm_wire.operator_messages import Status


class Reporter:
    """Takes what there is to tell of a run. This one tells nobody."""

    def update(self, status: Status, messages_per_s: float | None) -> None:
        """The newest state."""

    def say(self, text: str) -> None:
        """Something that the user has to do."""
