"""The truth of a run as the datagrams `hello` and `picture`, for the researcher's tools.

They have the format of the operator's station, with the operator's knowledge left empty and `truth` added.
"""

from typing import Any

import orjson

from deltaswarm_orchestrator.live.observer import Seen
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import Body, EventState, Truth
from deltaswarm_wire.operator_messages import Workload

PLACE_DIGITS = 3
"""Positions are rounded to a millimetre."""

RESEARCHER = "researcher"
"""The kind of a feed that shows what no operator knows."""

ENDED = "ended"
"""The phase of a world that has done its last step."""


def hello(run: str, scenario: Scenario) -> bytes:
    """Encode what does not change during a run: its name, arena and length."""
    arena, uplink = scenario.arena, scenario.uplink
    return orjson.dumps(
        {
            "type": "hello",
            "kind": RESEARCHER,
            "run": run,
            "title": f"{scenario.name}, {scenario.control.mode}",
            "step_s": scenario.run.step_s,
            "duration_s": scenario.run.steps * scenario.run.step_s,
            "arena_m": [arena.width_m, arena.height_m],
            "obstacles": [obstacle.corners_m for obstacle in arena.obstacles],
            "base_m": uplink.base_m,
            "range_m": uplink.range_m,
            "agents": scenario.agents.count,
            "thresholds_hz": [scenario.operator.threshold_hz],
            "commands": [],
            "speeds": [],
            "session": None,
        }
    )


def picture(seen: Seen) -> bytes | None:
    """Encode what there is to see of a run now; None before there is anything."""
    truth, status, workload = seen.newest_truth, seen.status, seen.newest_workload
    newest = truth or workload or status
    if newest is None:
        return None
    told: dict[str, Any] = {
        "type": "picture",
        "step": newest.step,
        "time_s": newest.time_s,
        "over": status is not None and status.phase == ENDED,
        "agents": [],
        "events": [],
        "inbox": [],
        "unread": 0,
        "workload": _workload(workload, seen.messages),
        "commands": [],
        "pace": {"paused": False, "speed": 0.0},
        "probe": None,
        "truth": _truth(truth) if truth else None,
    }
    if status is not None:
        told["status"] = status._asdict()
    return orjson.dumps(told)


def _truth(truth: Truth) -> dict[str, Any]:
    return {
        "agents": [_agent(body) for body in truth.bodies],
        "events": [_event(event) for event in truth.events if event.completed_s is None],
    }


def _agent(body: Body) -> tuple[int, float, float, str, int, int, int]:
    x_m, y_m = round(body.x_m, PLACE_DIGITS), round(body.y_m, PLACE_DIGITS)
    return body.agent, x_m, y_m, body.role, body.parent, body.root, body.delta


def _event(event: EventState) -> tuple[int, float, float, float]:
    return event.event, round(event.x_m, PLACE_DIGITS), round(event.y_m, PLACE_DIGITS), event.arrived_s


def _workload(workload: Workload | None, messages: int | None) -> dict[str, Any]:
    rates = workload._asdict() if workload else dict.fromkeys(("rate_1s_hz", "rate_60s_hz", "time_above_s"), 0.0)
    return {
        "messages": messages,
        "rate_1s_hz": rates["rate_1s_hz"],
        "rate_60s_hz": rates["rate_60s_hz"],
        "senders": rates.get("senders", 0),
        "residue": 0.0,
        "above_s": [rates["time_above_s"]],
    }
