"""What a run's manifest and rows say about it and its participant: times, screen, consent, scales. No I/O."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from statistics import median
from typing import Any

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.technique import DURING, Technique
from deltaswarm_scenario.techniques import TECHNIQUES
from deltaswarm_scenario.tlx import SCALES, TLX

Row = Mapping[str, str]


def timed(techniques: Iterable[type[Technique]]) -> set[str]:
    """Return the names of those that ask during the run."""
    return {technique.name for technique in techniques if technique.title and technique.when == DURING}


TIMED = timed(TECHNIQUES)
"""Probes whose answers take a moment of the run."""


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
        "page_hidden_s": hidden_s(actions, times),
        "median_answer_s": median(seconds) if seconds else None,
        "tlx_scale": {
            row["item"]: float(row["value"]) for row in given if row["probe"] == TLX and row["item"] in SCALES
        },
    }


def hidden_s(actions: Sequence[Row], times: Sequence[float]) -> float | None:
    """Return for how long between the first and the last step every page of the participant was hidden."""
    if not times:
        return None
    pages: dict[str, bool] = {}  # whether each open page is hidden
    total_s, since_s = 0.0, min(times)
    shown = [row for row in actions if row["kind"] == "page" and row.get("monotonic_s")]
    for row in [*shown, {"monotonic_s": str(max(times)), "name": "closed"}]:
        at_s = min(max(float(row["monotonic_s"]), min(times)), max(times))
        total_s += (at_s - since_s) * bool(pages and all(pages.values()))
        since_s, page = at_s, row.get("page", "")
        if row["name"] == "closed":
            pages.pop(page, None)
        else:
            pages[page] = row["name"] == "hidden" or (pages.get(page, False) and row["name"] != "visible")
    return round(total_s, 3)


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
    translated = scenario.operator.page.language.of
    for technique in scenario.operator.probes.techniques:
        for one in technique.questions:
            has_bounds = one.kind != "text" and one.kind != "choice"
            yield {
                "probe": technique.name,
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
