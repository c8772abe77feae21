"""The task of the person at the station, to tell targets from decoys among the events, and its score.

The class of an event shows in nothing but how far the place jumps at which it is sensed. So all that the operator can
know of it comes from the places in reports.

d' and the criterion c are those of signal detection theory (Green and Swets 1966). The log-linear correction of Hautus
(1995) keeps them finite at a rate of 0 or 1.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist
from typing import Annotated, Any, NamedTuple

from deltaswarm_scenario.columns import Column
from deltaswarm_scenario.technique import Measure, Recorded, ScoredTable, Technique
from deltaswarm_wire.checked import OURS, key

JUDGE = "judge"
"""The act of judging an event."""
TARGET, DECOY = "target", "decoy"
CLASSES = (TARGET, DECOY)

GOAL = "Judge each event: target or decoy. A target stays where it is from report to report; a decoy seems to jump."


@dataclass(frozen=True)
class TaskSettings:
    """How many events are targets, how each class looks, and what the person is told."""

    target_share: float = key(
        0.0, "probability that an event is a target, else a decoy; 0: there is no task", source=OURS, low=0, high=0.99
    )
    target_jump_m: float = key(
        0.3,
        "standard deviation along x and y by which a target's sensed place is off [m]",
        source=OURS,
        low=0,
        high=100,
    )
    decoy_jump_m: float = key(2.0, "the same for a decoy [m]", source=OURS, low=0, high=100)
    jump_every_s: float = key(10.0, "interval after which the place is off by another error [s]", source=OURS, above=0)
    goal: str = key(GOAL, "what the page says of the task")

    @property
    def is_on(self) -> bool:
        """Whether events have classes, which the person judges."""
        return self.target_share > 0


class JudgementRow(NamedTuple):
    """An event that was reported, and what the person judged it to be, in `judgements.csv`."""

    number: Annotated[int, Column("", "the event's number on the page")]
    event: Annotated[int, Column("", "the event in events.csv")]
    truth: Annotated[str, Column("", "its class: target or decoy")]
    answer: Annotated[str, Column("", "the last judgement: target or decoy; empty: none")]
    answered_s: Annotated[float | None, Column("s", "time of the last judgement")]
    changes: Annotated[int, Column("", "how often the judgement was changed")]


def judgement_rows(
    numbers: Iterable[tuple[int, int]], targets: Iterable[int], acts: Iterable[Mapping[str, str]]
) -> Iterator[JudgementRow]:
    """Yield a row for each reported event, given as its number on the page and its id."""
    answers: dict[int, list[tuple[str, float]]] = {}
    for act in acts:
        if act["kind"] == JUDGE:
            answers.setdefault(int(act["event"]), []).append((act["name"], float(act["time_s"])))
    for number, event in numbers:
        given = answers.get(number, [])
        answer, answered_s = given[-1] if given else ("", None)
        changes = sum(now[0] != before[0] for before, now in pairwise(given))
        yield JudgementRow(number, event, TARGET if event in targets else DECOY, answer, answered_s, changes)


def score(rows: Sequence[JudgementRow]) -> dict[str, Any]:
    """Return numbers of events by class and answer, the share that was judged right, d' and c.

    An event without a judgement counts as not right. d' and c are of the judged events alone, and None unless targets
    and decoys were judged.
    """
    count = Counter((row.truth, row.answer) for row in rows)
    hits, false_alarms = count[TARGET, TARGET], count[DECOY, TARGET]
    misses, rejections = count[TARGET, DECOY], count[DECOY, DECOY]
    targets, decoys = hits + misses, false_alarms + rejections
    d_prime = criterion = None
    if targets and decoys:
        z = NormalDist().inv_cdf
        z_hit, z_false_alarm = z((hits + 0.5) / (targets + 1)), z((false_alarms + 0.5) / (decoys + 1))
        d_prime, criterion = z_hit - z_false_alarm, -(z_hit + z_false_alarm) / 2
    return {
        "events": len(rows),
        "hits": hits,
        "misses": misses,
        "false_alarms": false_alarms,
        "correct_rejections": rejections,
        "unjudged": len(rows) - targets - decoys,
        "share_right": (hits + rejections) / len(rows) if rows else None,
        "d_prime": d_prime,
        "criterion": criterion,
    }


def _judged(run: Recorded) -> list[JudgementRow] | None:
    """Return what was reported and judged in a run; None if there was no task or nobody to do it."""
    numbers = run.rows("event_numbers")
    if run.targets is None or numbers is None:
        return None
    pairs = [(int(row["number"]), int(row["event"])) for row in numbers]
    return list(judgement_rows(pairs, run.targets, run.rows("actions") or ()))


class JudgementTask(Technique):
    """The task. It is on the page during the whole run, and each judgement is an act, so it asks no question."""

    name, kind = "task", JUDGE
    measures = tuple(
        Measure(f"task.{name}", meaning, column, "operator.task.target_share", is_whole=is_whole)
        for name, meaning, column, is_whole in (
            ("share_right", "reported events that were judged right", "share_right", False),
            ("hits", "targets that were judged to be targets", "hits", True),
            ("misses", "targets that were judged to be decoys", "misses", True),
            ("false_alarms", "decoys that were judged to be targets", "false_alarms", True),
            ("correct_rejections", "decoys that were judged to be decoys", "correct_rejections", True),
            ("unjudged", "reported events without a judgement", "unjudged", True),
            ("events", "reported events", "", True),
            ("d_prime", "sensitivity d' of the judgements, log-linear", "d_prime", False),
            ("criterion", "criterion c of the judgements; above 0: rather decoy", "criterion", False),
        )
    )
    texts = (GOAL,)
    scored = ScoredTable("judgements", JudgementRow, _judged, lambda rows: {"task": score(rows)})

    @classmethod
    def of(cls, settings: Any) -> Iterable[Technique]:
        return []
