"""The learned rule: two weighted sums of an agent's own experience (`experience.py`) give it its structure.

The structure is on the scale of the order `set structure`. The sums are in a fixed order, so that every engine and
board has the same bits. With weights of 0 an agent has delta 3 and works, as under hybrid control.
"""

import json
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

INPUTS = (
    "busy",
    "find_rate",
    "crowd",
    "attending_heard",
    "members_heard",
    "reports",
    "in_trees",
    "since_find",
    "since_change",
    "attends",
    "price",
)
"""What the rule is given, each from -1 to 1 (`Experience.inputs`)."""

OUTPUTS = ("delta", "working")
WEIGHTS = len(OUTPUTS) * (1 + len(INPUTS))
"""For each output a constant and one number per input."""

MAX_WEIGHT = 1000.0

FIRST_DELTA, GAIN = 3.0, 3.0
"""Delta with an output of 0, and its change with an output of 1."""

LEAST_DELTA, FAR_DELTA = 2.0, 12.0
"""Delta is not below the first; an agent whose delta is above the second never founds a tree."""

SHIPPED = "policy.json"


class Structure(NamedTuple):
    """Events sensed at once that make an agent a root (None: never), and whether it works outside trees."""

    founds_at: int | None
    attends: bool


def outputs(weights: Sequence[float], inputs: Sequence[float]) -> tuple[float, float]:
    """Return the two sums."""
    count = len(INPUTS)
    delta, working = weights[0], weights[1 + count]
    for k in range(count):
        delta += weights[1 + k] * inputs[k]
        working += weights[2 + count + k] * inputs[k]
    return delta, working


def structure_of(weights: Sequence[float], inputs: Sequence[float], rank: float) -> Structure:
    """Return the structure of the agent with this place among all (`Agent.rank`): fractions of agents by rank."""
    delta, working = outputs(weights, inputs)
    delta, attends = FIRST_DELTA + GAIN * delta, rank < 1.0 + working
    if delta > FAR_DELTA:
        return Structure(None, attends)
    delta = max(delta, LEAST_DELTA)
    least = int(delta)
    return Structure(least + (rank < delta - least), attends)


def policy_of(record: Any) -> tuple[float, ...]:
    """Return the numbers of a policy's file, as `deltaswarm learn delta` writes it.

    Raises:
        ValueError: it is the file of another rule, or its digest is not that of its numbers.
    """
    from deltaswarm_wire.digest import of_numbers  # of three megabytes, which a board can spare

    try:
        weights = tuple(map(float, record["weights"]))
        told = tuple(record["inputs"]), len(weights), record["digest"]
    except (LookupError, TypeError) as error:
        raise ValueError(f"must be a policy's file (got {error!r})") from None
    needed = INPUTS, WEIGHTS, of_numbers(weights)
    if told != needed:
        raise ValueError(f"must be a policy with inputs, numbers and digest {needed} (got {told})")
    return weights


@cache
def shipped() -> tuple[float, ...]:
    """Return the numbers of the policy that is shipped with this file; its digest is tested, not checked here."""
    from pkgutil import get_data  # needed by this rule alone

    data = get_data(__package__, SHIPPED)
    assert data is not None
    return tuple(json.loads(data)["weights"])
