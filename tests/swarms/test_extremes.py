"""No scenario that is accepted makes a run fail by its numbers."""

import dataclasses
import typing
from collections.abc import Iterator
from typing import Any

import pytest

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import MAX_NUMBER, MIN_POSITIVE, SettingsError
from deltaswarm_wire.plugins import find_controller

STEPS = 3


def extremes(cls: Any, path: str) -> Iterator[tuple[str, float]]:
    """Each number of the settings at both of its limits."""
    hints = typing.get_type_hints(cls)
    for spec in dataclasses.fields(cls):
        hint, limits = hints[spec.name], spec.metadata
        hint = next((arm for arm in typing.get_args(hint) if arm is not type(None)), hint)
        if typing.get_origin(hints[spec.name]) is tuple:
            continue
        if dataclasses.is_dataclass(hint):
            yield from extremes(hint, f"{path}{spec.name}.")
        elif hint in (int, float):
            low, high, above = (limits[name] for name in ("low", "high", "above"))
            least = low if low is not None else -MAX_NUMBER if above is None else above + MIN_POSITIVE
            for value in (least, MAX_NUMBER if high is None else high):
                yield f"{path}{spec.name}", hint(value)


CASES = [("", *case) for case in extremes(Scenario, "") if case[0] != "agents.count"]
CASES += [
    (mode, *case)
    for mode in ("hybrid", "adaptive", "potential")
    for case in extremes(find_controller(mode).Settings, "control.")
]


def outcome(mode: str, key: str, value: float) -> str:
    """What becomes of a short run with this value."""
    settings = ["record=off", f"{key}={value!r}", *([f"control.mode={mode}"] if mode else [])]
    try:
        swarm = InProcess(load_scenario("smoke", settings))
    except SettingsError:
        return "refused"
    try:
        for _ in swarm.steps(STEPS - 1):
            pass
    except Exception as error:
        return f"{settings}: {error!r}"
    return "done"


def test_a_number_at_its_limit_is_refused_or_works() -> None:
    """Each number of a scenario and of the controllers, at both limits, in a run of a few steps."""
    assert len(CASES) > 200
    assert {outcome(*case) for case in CASES} == {"done", "refused"}


@pytest.mark.parametrize("value", ["1e200", "-1e200", "1e-300", "inf", "nan", "1" + "0" * 400])
def test_a_number_beyond_every_use_is_refused(value: str) -> None:
    """By a key that states no limit of its own."""
    with pytest.raises(SettingsError) as caught:
        load_scenario("smoke", [f"agents.sensing_range_m={value}"])
    (problem,) = caught.value.problems
    assert problem.path == "agents.sensing_range_m"
