"""The arguments of everything that `import deltaswarm` offers: a wrong one is named before anything is done."""

import inspect
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import deltaswarm
from deltaswarm import testing
from deltaswarm.keys import overrides
from deltaswarm_learn.batch import SwarmVectorEnv
from deltaswarm_learn.environment import SwarmEnv

WRONG = [
    object(),
    "a\0b",
    "\ud800",
    b"x",
    math.nan,
    math.inf,
    -math.inf,
    -1,
    10**400,
    [object()],
    {1: 2, "a\0b": object()},
]
"""Values of which no argument takes one."""

MADE: dict[str, Callable[..., Any]] = {"parallel_env": SwarmEnv, "env": SwarmEnv, "vector_env": SwarmVectorEnv}
"""Whose arguments these functions take."""

REQUIRED = {"runs": 2, "folder": ".", "sweep": "smoke", "study": "paper", "cls": object, "file": "x.mcap"}


def _public() -> Iterator[tuple[Callable[..., Any], inspect.Signature]]:
    """Yield the functions, and the methods of classes, with what they take."""
    for module, names in ((deltaswarm, deltaswarm.__all__), (testing, vars(testing))):
        for name in names:
            value = getattr(module, name)
            is_own = inspect.getmodule(value) is testing or module is deltaswarm
            if inspect.isfunction(value) and is_own and not name.startswith("_"):
                yield value, inspect.signature(MADE.get(name, value))
    yield testing.Swarm, inspect.signature(testing.Swarm)
    run = object.__new__(deltaswarm.Run)
    for name, method in inspect.getmembers(run, inspect.ismethod):
        if not name.startswith("_"):
            yield method, inspect.signature(method)


def test_every_wrong_argument_of_every_public_function_is_named() -> None:
    """As a `deltaswarm.Error` with its name, what must hold and what was given."""
    public = list(_public())
    there = {function.__name__ for function, _ in public}
    assert {
        "run",
        "open",
        "sweep",
        "study",
        "parallel_env",
        "env",
        "vector_env",
        "controller",
        "Swarm",
        "show",
    } <= there
    for function, signature in public:
        required = {name for name, one in signature.parameters.items() if one.default is one.empty}
        for name in signature.parameters:
            for value in WRONG:
                if name == "keys" and isinstance(value, dict):
                    continue  # what is in a mapping of keys is the scenario's
                given = {other: REQUIRED[other] for other in required} | {name: value}
                with pytest.raises(deltaswarm.Error, match=rf"^{name} must be .* \(got "):
                    function(**given)


def test_numbers_of_numpy_and_paths_are_taken() -> None:
    made = testing.percept(np.int64(3), (np.float32(1), 2), events=iter([(4.0, 5.0)]), heard={0: b"x"}, step_s=2)
    assert (made.step, made.time_s, made.pose) == (3, 6, (1.0, 2))
    assert type(made.step) is int


@pytest.mark.parametrize("value", [10**5000, [[[]]] * 2, {"a": {}}], ids=["huge", "list", "table"])
def test_keys_that_no_file_could_hold_are_refused(value: Any) -> None:
    """An integer of thousands of digits, and what holds itself."""
    if isinstance(value, list):
        value.append(value)
    elif isinstance(value, dict):
        value["a"]["a"] = value
    with pytest.raises(deltaswarm.Error, match="must"):
        overrides({"run.duration_s": value})
