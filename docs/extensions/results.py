"""Make the parts of pages that list what runs write: keys of the summary, metrics, and tables about a person.

Each part is between marks `<!-- NAME -->` and `<!-- /NAME -->`.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from deltaswarm_orchestrator.results.summary import EVERY_KEY
from deltaswarm_scenario.columns import columns_of
from deltaswarm_scenario.person_tables import TABLES
from deltaswarm_scenario.truth import AIR_REASONS, DROP_REASONS, UPLINK_REASONS
from deltaswarm_wire.plugins import RADIO_MODELS, find

DOCS = Path(__file__).parents[1]


def summary_keys() -> Iterator[str]:
    """Describe every key of the summary."""
    yield from ("| key | unit | meaning |", "| --- | --- | --- |")
    for metric in EVERY_KEY:
        if metric.is_in_summary:
            yield f"| `{metric.key}` | {metric.unit} | {metric.meaning} |"


def study_metrics() -> Iterator[str]:
    """Describe every metric that a study may use."""
    yield from ("| metric | unit | meaning | over time | ceiling |", "| --- | --- | --- | --- | --- |")
    for metric in EVERY_KEY:
        if metric.study:
            over_time = "yes" if metric.over else ""
            ceiling = "horizon" if metric.is_restricted else ""
            yield f"| `{metric.study}` | {metric.unit} | {metric.meaning} | {over_time} | {ceiling} |"


def metrics_in(part: str) -> Iterator[str]:
    """Describe every metric in a part of the summary."""
    yield from (f"| in `{part}` | unit | meaning |", "| --- | --- | --- |")
    for metric in EVERY_KEY:
        if metric.is_in_summary and metric.key.startswith(f"{part}."):
            yield f"| `{metric.key.removeprefix(f'{part}.')}` | {metric.unit} | {metric.meaning} |"


def person_tables() -> Iterator[str]:
    """Describe every column of every table about a person at the console."""
    for name, table in TABLES.items():
        about = (table.__doc__ or "").partition(", in ")[0]
        yield from ("", f"## `{name}.csv`: {about[0].lower()}{about[1:]}", "")
        yield from ("| column | unit | meaning |", "| --- | --- | --- |")
        for column, (_, (unit, meaning)) in columns_of(table).items():
            yield f"| `{column}` | {unit} | {meaning} |"


def drop_reasons() -> Iterator[str]:
    """List every reason for a drop, with what it means for a frame and for a report."""
    frames = {name: find(RADIO_MODELS, name, "radio").meaning for name in RADIO_MODELS.shipped} | AIR_REASONS
    yield "| reason | a frame did not reach a receiver because | a report did not reach the operator because |"
    yield "| --- | --- | --- |"
    for reason in dict.fromkeys((*DROP_REASONS, *UPLINK_REASONS)):
        cells = (f"`{reason}`", frames.get(reason, ""), UPLINK_REASONS.get(reason, ""))
        yield "".join(f"| {cell} " if cell else "| " for cell in cells) + "|"


PARTS: dict[str, dict[str, Callable[[], Iterator[str]]]] = {
    "RESULTS.md": {"reasons": drop_reasons, "person": person_tables, "summary": summary_keys},
    "STUDIES.md": {"metrics": study_metrics},
    "OPERATOR.md": {"metrics": partial(metrics_in, "person"), "inbox": partial(metrics_in, "inbox")},
}
"""What is made, by page and mark."""


def with_parts(name: str, text: str) -> str:
    """Return the page with its parts as the code makes them now."""
    for mark, make in PARTS[name].items():
        begin, end = f"<!-- {mark} -->\n", f"<!-- /{mark} -->\n"
        before, rest = text.split(begin)
        text = before + begin + "\n".join(make()).rstrip() + "\n\n" + end + rest.split(end)[1]
    return text


if __name__ == "__main__":
    for name in PARTS:
        page = DOCS / name
        page.write_text(with_parts(name, page.read_text()))
