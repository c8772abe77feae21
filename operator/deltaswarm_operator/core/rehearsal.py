"""What becomes of a run's planned questions if the person takes all the time there is for each. Pure."""

import math
from typing import Any

from deltaswarm_operator.core.probes import CUT, NOT_ASKED, Probes
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_scenario.technique import Seen

LEAST_SHARE = 0.5
"""A question that the end cuts off in this share of its time has too little of it."""


def rehearse(briefing: Briefing) -> list[ProbeRow]:
    """Return the rows of all questions during a run at the briefing's speed, answered at the last moment or not."""
    probes = Probes.of(briefing)
    for step in range(1, math.ceil(briefing.duration_s / briefing.step_s) + 1):
        now_s = min(step * briefing.step_s, briefing.duration_s)
        wall_s = now_s / briefing.speed if briefing.speed else 0.0
        is_last = now_s >= briefing.duration_s
        probes.tick(now_s, is_last, wall_s, is_attended=True, is_held=True, see=Seen)
        asked = probes.open(wall_s)
        if asked is None or is_last:
            continue
        if asked.get("left_s") is None:
            probes.skip(wall_s)
        elif asked.get("prompt") and asked["left_s"] * briefing.speed <= briefing.step_s:
            message: dict[str, Any] = {"form": asked["form"]["name"], "number": asked["number"]}
            probes.be_ready(message, now_s, wall_s, Seen())
    return probes.rows


def plan_warning(briefing: Briefing) -> str | None:
    """Return a warning if some planned questions would not be asked, or had too little time; None if all fit."""
    rows = {(row.probe, row.number): row for row in rehearse(briefing)}
    waits_s = {one.name: one.wait_s or 0.0 for one in briefing.operator.probes.techniques}

    def fits(row: ProbeRow) -> bool:
        if row.outcome != CUT:
            return not row.outcome.startswith(NOT_ASKED)
        left_s = briefing.duration_s - (row.asked_s or 0.0)
        return left_s >= LEAST_SHARE * waits_s[row.probe] * briefing.speed > 0

    lost = [row for row in rows.values() if not fits(row)]
    if not lost:
        return None
    first = min(lost, key=lambda row: row.planned_s or 0.0)
    pace = f"at {briefing.speed:g} times real time" if briefing.speed else "as fast as possible"
    return (
        f"the plan of questions must fit into the run: {pace}, {len(lost)} of {len(rows)} would not be asked or be cut "
        f"off if the person takes all the time there is (the first: {first.probe} at {first.planned_s:g} s, "
        f"{first.outcome}); ask less often, give less time to answer, or choose a lower speed"
    )
