"""The tasks on which a rule for delta is trained, validated and tested: drawn by fixed seeds, from three streams. Pure.

A task is a place, a rate and a density of events, a swarm and its radio, and a price of messages. Tasks of the stream
`TEST` are for a study: nobody runs one before its protocol is frozen.
"""

import math
from random import Random
from typing import Any

TRAINING, VALIDATION, TEST = STREAMS = ("training", "validation", "test")

BASE = "paper-25"
"""The scenario whose keys a task replaces."""

DURATION_S = 1800.0

AGENTS = 12, 100
RATE_HZ = 0.01, 0.2
MAX_LOAD = 0.9
"""No task has more work than this share of its agents could do."""

WORK_AGENT_S = 200.0

ROOM_M = 100.0
"""Side of the arena for the paper's 25 agents; others have as much room each, up to a factor."""

PRICE_S = 0.05, 20.0

FREE = 0.1
"""The share of tasks in which messages cost nothing."""

GOLDEN_RATIO = (5**0.5 - 1) / 2
"""Prices of tasks with consecutive numbers are spread evenly by its multiples, modulo 1."""


def task(stream: str, number: int) -> dict[str, Any]:
    """Return the keys that a task sets, by dotted names."""
    if stream not in STREAMS:
        raise ValueError(f"stream must be one of {', '.join(STREAMS)} (got {stream!r})")
    drawn = Random(f"deltaswarm learn delta, {stream} {number}")
    count = round(_log_uniform(drawn, *AGENTS))
    side_m = ROOM_M * math.sqrt(count / 25) * drawn.uniform(0.75, 1.3)
    longer = drawn.uniform(0.8, 1.25)
    size_m = round(side_m * longer, 1), round(side_m / longer, 1)
    change_s = round(drawn.uniform(0.25, 0.7) * DURATION_S) if drawn.random() < 0.5 else 0
    moves = change_s and drawn.random() < 0.6
    most_hz = min(RATE_HZ[1], MAX_LOAD * count / WORK_AGENT_S)
    rates_hz = [round(_log_uniform(drawn, RATE_HZ[0], most_hz), 4) for _ in range(2)]
    density = _density(drawn, size_m, change_s if moves else 0)
    changes = change_s and (not moves or density["kind"] == "uniform" or drawn.random() < 0.3)
    return {
        "seed": drawn.randrange(2**31),
        "run.duration_s": DURATION_S,
        "arena.width_m": size_m[0],
        "arena.height_m": size_m[1],
        "agents.count": count,
        "events.rate_hz": rates_hz[0],
        "events.rates_hz": rates_hz[1:] if changes else [],
        "events.rates_s": [float(change_s)] if changes else [],
        "events.density": density,
        "radio.loss": round(drawn.uniform(0.0, 0.3), 3) if drawn.random() < 0.5 else 0.0,
        "control.message_price": _price_s((STREAMS.index(stream) / len(STREAMS) + number * GOLDEN_RATIO) % 1),
    }


def _price_s(share: float) -> float:
    """Return the price that this share of the tasks does not exceed [s]."""
    place = (share - FREE) / (1.0 - FREE)
    return 0.0 if place < 0 else round(PRICE_S[0] * (PRICE_S[1] / PRICE_S[0]) ** place, 3)


def _log_uniform(drawn: Random, low: float, high: float) -> float:
    return math.exp(drawn.uniform(math.log(low), math.log(high)))


def _density(drawn: Random, size_m: tuple[float, float], jump_s: float) -> dict[str, Any]:
    """Draw places of unequal size, a ring of places, the corners, or no place at all; places may jump once."""
    kind = drawn.choices(("places", "ring", "corners", "uniform"), (11, 3, 3, 3))[0]
    if kind == "uniform":
        return {"kind": "uniform"}
    if kind == "ring":
        places = _ring(drawn, size_m)
    elif kind == "corners":
        places = [(size_m[0] * x, size_m[1] * y) for x in (0.15, 0.85) for y in (0.15, 0.85)]
    else:
        places = [_place(drawn, size_m) for _ in range(drawn.randint(1, 4))]
    after = [_place(drawn, size_m) for _ in places]
    spread_m = drawn.uniform(3.0, 10.0)
    components = []
    for before_m, after_m in zip(places, after, strict=True):
        weight = drawn.uniform(0.7, 1.3) if kind == "ring" else drawn.expovariate(1.0) + 0.1
        variance_m2 = round((spread_m * drawn.uniform(0.6, 1.4)) ** 2, 2)
        mean_m = [round(number, 2) for number in before_m]
        component: dict[str, Any] = {
            "weight": round(weight, 3),
            "mean_m": mean_m,
            "covariance_m2": [[variance_m2, 0.0], [0.0, variance_m2]],
        }
        if jump_s:
            to_m = [round(number, 2) for number in after_m]
            component |= {"path_m": [mean_m, mean_m, to_m], "path_s": [0.0, float(jump_s), float(jump_s)]}
        components.append(component)
    return {"kind": "mixture", "components": components}


def _place(drawn: Random, size_m: tuple[float, float]) -> tuple[float, float]:
    return size_m[0] * drawn.uniform(0.12, 0.88), size_m[1] * drawn.uniform(0.12, 0.88)


def _ring(drawn: Random, size_m: tuple[float, float]) -> list[tuple[float, float]]:
    """Return ten places on a ring around the middle."""
    radius, turn = drawn.uniform(0.2, 0.38), drawn.random()
    angles = [math.tau * (turn + k / 10) for k in range(10)]
    return [(size_m[0] * (0.5 + radius * math.cos(a)), size_m[1] * (0.5 + radius * math.sin(a))) for a in angles]
