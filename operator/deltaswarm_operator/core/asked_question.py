"""A question that was asked, and the times that a page's messages about it state. Pure."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from deltaswarm_scenario.technique import Technique


def delay_s(message: Mapping[str, Any]) -> float:
    """Return how long a page kept an input before it could send it [s]."""
    page_s, sent_s = message.get("page_s"), message.get("sent_s")
    return 0.0 if page_s is None or sent_s is None else max(0.0, round(sent_s - page_s, 3))


def reaction_s(message: Mapping[str, Any]) -> float | None:
    """Return the time from the frame that showed a question to the answer, by the page's clock [s]."""
    shown_s, page_s = message.get("shown_s"), message.get("page_s")
    return None if shown_s is None or page_s is None else round(page_s - shown_s, 3)


class Asked(NamedTuple):
    technique: Technique
    number: int
    asked_s: float
    asked_wall_s: float
    planned_s: float
    held_s: float = 0.0
    """Wall time since then in which the run was held [s]."""
    known: Mapping[str, str] = {}
    """The answer to each item that is right by what the page showed."""
    ready: "Ready | None" = None
    """How the person became ready, after a prompt."""
    cut_wall_s: float = math.inf
    """When the run ended while there was time to answer."""

    @property
    def items(self) -> tuple[str, ...]:
        return tuple(self.technique.items(self.number))

    @property
    def holds_run(self) -> bool:
        return self.technique.wait_s is None

    @property
    def is_prompt(self) -> bool:
        """Whether the person is still to say to be ready."""
        return self.technique.has_prompt and self.ready is None

    @property
    def since_wall_s(self) -> float:
        """Return when the time to answer began, or that to become ready."""
        return self.asked_wall_s if self.ready is None else self.ready.wall_s


class Ready(NamedTuple):
    """When the person was ready for a question, and for how long its prompt had been there."""

    ready_s: float
    wall_s: float
    latency_s: float
    reaction_s: float | None
