"""What a session asks of a participant, before it begins: runs, their length, questions and forms. Pure.

The order of the conditions is not told as long as it is concealed from the experimenter.
"""

from collections.abc import Sequence
from typing import Any

from deltaswarm_orchestrator.base.text import aligned
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_sessions.plan import PlannedRun
from deltaswarm_sessions.settings import SessionSettings

COLUMNS = ("run", "scenario", "simulated s", "wall min", "asks")


def outline(settings: SessionSettings, planned: Sequence[PlannedRun], *, is_concealed: bool) -> dict[str, Any]:
    """Return the runs, training first: in the order of the file if that of the participant is concealed."""
    runs = list(planned)
    if is_concealed:
        labels = [condition.label for condition in settings.condition]
        runs[1:] = sorted(runs[1:], key=lambda run: labels.index(run.label))
    rows = [_row(run.label, run.scenario, settings.speed) for run in runs]
    minutes = [row["wall_min"] for row in rows]
    return {
        "runs": rows,
        "is_order_concealed": is_concealed,
        "training_runs_at_most": settings.training.criterion.max_runs if settings.training.criterion else 1,
        "wall_min": None if None in minutes else sum(minutes),
        "forms": {form.name: form.when for form in settings.form},
    }


def outline_text(outlined: dict[str, Any]) -> str:
    """Format the result of `outline`."""
    rows = [
        (row["label"], row["scenario"], f"{row['simulated_s']:g}", _minutes(row["wall_min"]), "; ".join(row["asks"]))
        for row in outlined["runs"]
    ]
    lines = [aligned([COLUMNS, *rows]), ""]
    if outlined["is_order_concealed"]:
        lines.append("The order of the runs after the training is shown once the session has begun.")
    if forms := ", ".join(f"{name} ({when})" for name, when in outlined["forms"].items()):
        lines.append(f"Forms of the session: {forms}.")
    if (most := outlined["training_runs_at_most"]) > 1:
        lines.append(f"Training: until the criterion is reached, at most {most} runs.")
    if outlined["wall_min"] is not None:
        lines.append(f"All runs take {outlined['wall_min']:.0f} min, besides questions, forms and repeated training.")
    return "\n".join(lines)


def _row(label: str, scenario: Scenario, speed: float) -> dict[str, Any]:
    return {
        "label": label,
        "scenario": scenario.name,
        "simulated_s": scenario.run.duration_s,
        "wall_min": scenario.run.duration_s / speed / 60 if speed else None,
        "asks": [
            *filter(None, (one.outline for one in scenario.operator.probes.techniques)),
            *(["task"] if scenario.operator.task.is_on else []),
        ],
    }


def _minutes(minutes: float | None) -> str:
    return "as fast as possible" if minutes is None else f"{minutes:.1f}"
