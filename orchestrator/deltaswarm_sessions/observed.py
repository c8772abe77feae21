"""What a run's manifest and rows say about it and its participant: times, screen, consent, scales. No I/O."""

from collections.abc import Iterator, Mapping, Sequence
from statistics import median
from typing import Any

from deltaswarm_scenario.isa import HIGHEST, ISA, LOWEST
from deltaswarm_scenario.questions import NUMBER, QuestionSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.situation import SAGAT, SITUATION, SPAM
from deltaswarm_scenario.tlx import SCALES, TLX

Row = Mapping[str, str]

TIMED = (ISA, SAGAT, SPAM)
"""Probes whose answers take a moment of the run."""

ANSWERS = ("under-used", "relaxed", "comfortable", "high", "excessive")
EVENLY = ("very low", "very high")

STANDARD = {
    ISA: [
        QuestionSettings(
            ISA, "How busy are you right now?", NUMBER, float(LOWEST), float(HIGHEST), ANSWERS[0], ANSWERS[-1], ANSWERS
        )
    ],
    TLX: [
        QuestionSettings(scale, f"NASA-TLX, {scale}", NUMBER, 0.0, 100.0, *ends)
        for scale in SCALES
        for ends in [("perfect", "failure") if scale == "performance" else EVENLY]
    ],
}
"""Questions of instruments that are the same in all scenarios."""


def of_run(
    manifest: Mapping[str, Any], actions: Sequence[Row], answers: Sequence[Row], walls: Sequence[Row]
) -> dict[str, Any]:
    """Return the columns of a run that its summary does not have, for the keys of `RUN_ITSELF`."""
    times = [float(row["monotonic_s"]) for row in walls]
    sizes = [row["text"] for row in actions if row["kind"] == "page" and row["name"] == "size"]
    given = [row for row in answers if row.get("answered_utc")]
    taken = {(row["probe"], row["number"]): row for row in given if row["probe"] in TIMED}
    seconds = [float(text) for row in taken.values() if (text := row.get("reaction_s") or row.get("latency_s"))]
    return {
        "started": manifest.get("started"),
        "wall_duration_s": max(times) - min(times) if times else None,
        "screen": "; ".join(dict.fromkeys(sizes)),
        "median_answer_s": median(seconds) if seconds else None,
        "tlx_scale": {
            row["item"]: float(row["value"]) for row in given if row["probe"] == TLX and row["item"] in SCALES
        },
    }


def version_of(manifest: Mapping[str, Any]) -> str:
    """Return the version of deltaswarm that made a run, with its commit; empty if neither is known."""
    version, commit = (manifest.get("versions") or {}).get("deltaswarm"), manifest.get("commit")
    return " ".join(filter(None, (version, commit and f"({commit})")))


def consent_of(actions: Sequence[Row]) -> str:
    """Return the SHA-256 of the text that the participant agreed to in a run; empty if none was shown."""
    sheets = (part for row in actions if row["kind"] == "sheet" for part in row["text"].split("; "))
    return next((part.partition("=")[2] for part in sheets if part.startswith("consent_sha256=")), "")


def questions_of(scenario: Scenario) -> Iterator[dict[str, Any]]:
    """Yield a row for each question that a run can ask, in the words of the page in its language."""
    probes, translated = scenario.operator.probes, scenario.operator.page.language.of
    asked: dict[str, Sequence[QuestionSettings]] = {form.name: form.question for form in probes.form}
    asked |= {ISA: STANDARD[ISA]} if probes.isa_every_s else {}
    asked |= {TLX: STANDARD[TLX]} if probes.tlx else {}
    if probes.sagat_at_s or probes.sagat_count:
        asked[SAGAT] = [SITUATION[name] for name in probes.sagat_questions]
    if probes.spam_at_s or probes.spam_count:
        asked[SPAM] = [SITUATION[name] for name in probes.spam_questions]
    for probe, questions in asked.items():
        for one in questions:
            has_bounds = one.kind != "text" and one.kind != "choice"
            yield {
                "probe": probe,
                "item": one.name,
                "language": scenario.operator.page.language.tag,
                "text": translated(one.text),
                "kind": one.kind,
                "low": f"{one.low:g}" if has_bounds else "",
                "high": f"{one.high:g}" if has_bounds else "",
                "low_text": translated(one.low_text),
                "high_text": translated(one.high_text),
                "choices": "; ".join(map(translated, one.choices)),
            }
