"""Define what a question technique is: when it asks, what the page shows, which answers it takes, how it is scored.

Each technique is one class in one file, with its scenario keys, and is listed in `techniques.py`. The operator asks
(`core/probes.py`). Only the orchestrator has the truth, and passes it to the scores.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from random import Random
from typing import Any, ClassVar, NamedTuple

from deltaswarm_scenario.truth import EventState, StepRecord
from deltaswarm_wire.checked import Problem

BEFORE, DURING, AFTER = "before", "during", "after"

Answers = Mapping[str, Any]
"""What is answered to one question, by item."""


class Recorded(NamedTuple):
    """What a run recorded, to compare answers with the truth."""

    rows: Callable[[str], Sequence[Mapping[str, str]] | None]
    """Returns the rows of one of the operator's tables; None if the run has no such table."""
    steps: Sequence[StepRecord] = ()
    events: Sequence[EventState] = ()
    targets: frozenset[int] | None = None
    """The events that are targets; None if there was no task."""
    width_m: float = 0.0
    height_m: float = 0.0


class Seen(NamedTuple):
    """What the participant's page shows of the swarm at the end of a step."""

    events_m: Sequence[tuple[float, float]] = ()
    """Places of the events that are reported [m]."""
    roots: Sequence[int] = ()
    """The root of each agent that is shown in a tree, roots included."""
    width_m: float = 0.0
    height_m: float = 0.0


class Measure(NamedTuple):
    """A number that a technique gives a run."""

    key: str
    """Its dotted name in `summary.json`."""
    meaning: str
    column: str
    """Its column in the table of a session's runs; empty: it has none."""
    needs: str
    """The scenario key without which a run does not have it."""
    title: str = ""
    """Its name on the axes and in the tables of studies; empty: studies do not use it."""
    is_whole: bool = False
    is_in_summary: bool = True
    """False: only the table of a session's runs has it, since it is known only after the run."""


class ScoredTable(NamedTuple):
    """A table of answers beside the truth."""

    name: str
    row: type[Any]
    score: Callable[[Recorded], Sequence[Any] | None]
    """Returns its rows; None if nothing was asked."""
    summarise: Callable[[Sequence[Any]], dict[str, Any]] | None = None
    """Returns what the summary has of the rows."""


class Technique:
    """A question technique as one run uses it."""

    name: str
    """Of its rows in `probes.csv`."""
    kind: str
    """What the page shows, and the type of the page's answer."""
    title: ClassVar[str] = ""
    """What it is called in messages."""
    when = DURING
    wait_s: float | None = None
    """Wall time to answer while the run goes on; None: the run is held until there is an answer."""
    needs_person = False
    """Whether it is asked only of a person at the station."""
    has_prompt = False
    """Whether the person says to be ready before the question is shown."""
    has_numbers: ClassVar[bool] = False
    """Whether all its answers are numbers."""
    scored: ClassVar[ScoredTable | None] = None
    measures: Sequence[Measure] = ()
    texts: ClassVar[Sequence[str]] = ()
    """What it says on the page, to be translated, besides what is in its panel."""

    @classmethod
    def of(cls, settings: Any) -> Iterable["Technique"]:
        """Return what a run with these settings uses of it: itself, several (forms), or nothing."""
        raise NotImplementedError

    @classmethod
    def problems(cls, settings: Any) -> list[Problem]:
        """Return the mistakes in its settings that involve several keys."""
        return []

    def problems_within(self, duration_s: float, step_s: float) -> list[Problem]:
        """Return the mistakes in its settings in a run of this length, in such steps."""
        return []

    def draw(self, rng: Random, duration_s: float) -> None:
        """Draw what is random in a run of this length."""

    @property
    def questions(self) -> Sequence[Any]:
        """What it may ask, as `QuestionSettings` (`questions.py`): its rows in the table of questions."""
        return ()

    def settle(self, number: int, seen: Seen) -> Sequence[str]:
        """Decide what a question asks by what the page shows now; return the items that cannot be asked now."""
        return ()

    def known(self, number: int, seen: Seen) -> Mapping[str, str]:
        """Return what is right by what the page shows, by item; empty if it asks nothing about that."""
        return {}

    def due_s(self, number: int, last_s: float, rng: Random) -> float:
        """Return the time at which a question during the run is due, after the last one; inf: never [s]."""
        return math.inf

    def items(self, number: int) -> Sequence[str]:
        """Return the items that a question asks for."""
        return ()

    def shown(self, number: int, asked_s: float, left_s: float | None) -> dict[str, Any]:
        """Return an open question in the page's format; `left_s`: remaining time to answer [wall s]."""
        return {"kind": self.kind}

    def is_meant(self, number: int, message: Mapping[str, Any]) -> bool:
        """Whether a page's message answers this question."""
        return True

    def answers(self, number: int, message: Mapping[str, Any]) -> Answers:
        """Return the answers in a page's message. Raises ValueError, with a text for the person: it is not complete."""
        return {}

    def act(self, answers: Answers) -> dict[str, Any]:
        """Return the columns of the act of answering in `actions.csv`."""
        return {}

    @staticmethod
    def simulated(load: float) -> Answers | None:
        """Return the answers of a simulated person with a load from 0 to 1; None: it does not answer."""
        return None

    @staticmethod
    def scores(given: Sequence[Answers]) -> dict[str, Any]:
        """Return what the summary has about the person's answers."""
        return {}

    @property
    def outline(self) -> str | None:
        """What a session's outline says of it."""
        return None
