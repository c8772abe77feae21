"""The message that describes a run to the page. Pure."""

from collections.abc import Sequence
from dataclasses import replace

from deltaswarm_operator.core.console import Console
from deltaswarm_scenario.page_messages import Message, made
from deltaswarm_wire.checked import plain
from deltaswarm_wire.commands import CommandForm

LIVE, CONDUCTOR_KIND = "live", "conductor"
NUMBERS_SHOWN = 1000
SPEEDS = (1, 2, 5, 10, 20, 50, 0)
SHEET_FIELDS = ("consent", "participant", "condition")


def is_refused(console: Console, form: CommandForm) -> bool:
    """Whether no agent of this run carries out a command."""
    return console.briefing.mode in form.refused_in


def page_hello(console: Console, run: str, kind: str = LIVE, speeds: Sequence[float] = SPEEDS) -> Message:
    briefing = console.briefing
    probes, page = briefing.operator.probes, briefing.operator.page
    return made(
        "hello",
        kind=kind,
        run=run,
        title=page.title or briefing.title,
        language=None if kind == CONDUCTOR_KIND else page.language.told,
        step_s=briefing.step_s,
        duration_s=briefing.duration_s,
        arena_m=[briefing.width_m, briefing.height_m],
        obstacles=[[list(corner) for corner in obstacle.corners_m] for obstacle in briefing.obstacles],
        base_m=briefing.base_m,
        range_m=briefing.range_m,
        radius_m=briefing.radius_m,
        agents=briefing.agents,
        thresholds_hz=console.thresholds_hz,
        inbox=console.ledger.about,
        commands=[  # the page need not know the control mode
            {**plain(replace(form, refused_in=())), "refused": is_refused(console, form)} for form in briefing.offered
        ],
        sets_delta=briefing.operator.autonomy.sets_delta,
        event_numbers=list(console.picture.event_numbers.items())[-NUMBERS_SHOWN:] if kind == CONDUCTOR_KIND else (),
        goal=briefing.operator.task.goal if briefing.operator.task.is_on else "",
        speeds=speeds if not console.in_air and (page.pace or kind != LIVE) else (),
        layers=page.layers,
        panels=[panel for panel in page.panels if panel != "help" or console.has_conductor],
        place=page.place,
        asks=briefing.operator.asks_in_passing,
        end_text=page.end_text,
        session={"sheet": {name: getattr(probes, name) for name in SHEET_FIELDS} if probes.has_sheet else None}
        | ({name: getattr(probes, name) for name in SHEET_FIELDS[1:]} if kind == CONDUCTOR_KIND else {}),
    )
