"""Score the person's task: `judgements.csv`, and hits, false alarms and d' in the summary.

d' and the criterion c are those of signal detection theory (Green and Swets 1966). The log-linear correction of Hautus
(1995) keeps them finite at a rate of 0 or 1.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import NormalDist
from typing import Any

from deltaswarm_orchestrator.recording import ACTIONS
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.run_tables import read_rows, write_csv
from deltaswarm_scenario.person_tables import JudgementRow
from deltaswarm_scenario.task import DECOY, TARGET

EVENT_NUMBERS, JUDGEMENTS = "event_numbers.csv", "judgements.csv"


def write_judgements(folder: Path, outcome: Outcome) -> None:
    """Write the table, if the person had a task."""
    rows = _judged(folder, outcome)
    if rows is not None:
        write_csv(folder / JUDGEMENTS, JudgementRow._fields, rows)


def task_score(folder: Path, outcome: Outcome) -> dict[str, Any]:
    """Return the summary's part about the person's task; empty if there was none."""
    rows = _judged(folder, outcome)
    return {} if rows is None else {"task": score(rows)}


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


def judgement_rows(
    numbers: Iterable[tuple[int, int]], targets: set[int], acts: Iterable[Mapping[str, str]]
) -> Iterator[JudgementRow]:
    """Yield a row for each reported event, given as its number on the page and its id."""
    answers: dict[int, list[tuple[str, float]]] = {}
    for act in acts:
        if act["kind"] == "judge":
            answers.setdefault(int(act["event"]), []).append((act["name"], float(act["time_s"])))
    for number, event in numbers:
        given = answers.get(number, [])
        answer, answered_s = given[-1] if given else ("", None)
        changes = sum(now[0] != before[0] for before, now in pairwise(given))
        yield JudgementRow(number, event, TARGET if event in targets else DECOY, answer, answered_s, changes)


def _judged(folder: Path, outcome: Outcome) -> list[JudgementRow] | None:
    """Read what was reported and judged in a run; None if there was no task or nobody to do it."""
    targets = outcome.world.get("targets")
    if targets is None or not (folder / EVENT_NUMBERS).exists():
        return None
    numbers = [(int(row["number"]), int(row["event"])) for row in read_rows(folder / EVENT_NUMBERS)]
    return list(judgement_rows(numbers, set(targets), read_rows(folder / ACTIONS)))
