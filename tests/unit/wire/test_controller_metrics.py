"""Tests of a controller's own numbers: what it may declare, and what crosses the wire."""

import math
from typing import Any

import pytest

from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.codec import WireError, pack, unpack
from deltaswarm_wire.controller_metrics import ControllerMetric, declared, mean_of, values_of
from deltaswarm_wire.messages import MAX_METRICS, Act, TreeStatus, decode_act, encode_act
from deltaswarm_wire.plugins import NoSettings
from tests.support.tiers import in_one_test

LEG = ControllerMetric("leg_m", "length of a leg", "m")
ACT = Act(1, 0.0, 0.0, (), TreeStatus(), 2)


class Declares:
    """A controller of which a test sets the declaration."""

    Settings = NoSettings
    Metrics: Any = ()
    step = None


@in_one_test(
    ("metrics", "wrong"),
    [
        ("leg", "a tuple of ControllerMetric"),
        ((LEG, "leg"), "a tuple of ControllerMetric"),
        ((LEG, LEG), "each with a name of its own"),
        (tuple(ControllerMetric(f"m{i}", "") for i in range(MAX_METRICS + 1)), f"at most {MAX_METRICS}"),
        ((ControllerMetric("leg m", ""),), "named by identifiers"),
        ((ControllerMetric("länge", ""),), "named by identifiers"),
        ((ControllerMetric("m" * 33, ""),), "named by identifiers"),
        ((ControllerMetric(3, ""),), "named by identifiers"),  # type: ignore[arg-type]
        ((ControllerMetric("m", "", per="agent"),), "per 'step' or 'run' (got 'agent' of m)"),
        ((ControllerMetric("m", "two\nlines"),), "printable"),
        ((ControllerMetric("m", "", None),), "printable"),  # type: ignore[arg-type]
    ],
)
def test_a_wrong_declaration_is_refused(metrics: Any, wrong: str) -> None:
    Declares.Metrics = metrics
    with pytest.raises(SettingsError) as raised:
        declared(f"{__name__}:Declares")
    assert wrong in str(raised.value)


@in_one_test(
    ("values", "error"),
    [
        (None, TypeError),
        ([1.0], TypeError),
        ({"legs": 1.0}, ValueError),
        ({"leg_m": math.nan}, ValueError),
        ({"leg_m": -math.inf}, ValueError),
        ({"leg_m": "long"}, ValueError),
        ({"leg_m": [1]}, TypeError),
    ],
)
def test_a_wrong_value_is_refused(values: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        values_of([LEG], values)


def test_a_value_may_be_absent() -> None:
    assert values_of([LEG], {"leg_m": None}) == values_of([LEG], {}) == ()
    assert values_of([LEG, ControllerMetric("legs", "")], {"legs": True, "leg_m": 3}) == (("leg_m", 3.0), ("legs", 1.0))


def test_the_swarms_number_is_a_mean() -> None:
    """Over the agents that have it, exactly, in any order; a name that nobody declared is ignored."""
    agents = [(("a", 0.1),), (("a", 0.2), ("b", 5.0)), (("a", 0.3), ("other", 1.0)), ()]
    expected = {"a": 0.2, "b": 5.0, "c": None}
    assert mean_of("abc", agents) == pytest.approx(expected)
    assert mean_of("abc", agents) == mean_of("abc", agents[::-1])


def test_an_act_carries_them() -> None:
    own = ACT._replace(metrics=(("leg_m", 1.5), ("legs", -2.0)))
    assert decode_act(encode_act(own)) == own
    assert decode_act(encode_act(ACT)) == ACT
    assert len(unpack(encode_act(ACT))) == 11


@in_one_test(
    "metrics",
    [
        {},
        None,
        [1.0],
        {"a": "b"},
        {1: 1.0},
        {"a": math.nan},
        {"a": 1e301},
        {"m" * 33: 1.0},
        {f"m{i}": 1.0 for i in range(MAX_METRICS + 1)},
    ],
)
def test_a_hostile_agents_are_refused(metrics: Any) -> None:
    raw = unpack(encode_act(ACT))
    with pytest.raises(WireError):
        decode_act(pack((*raw, metrics)))
    with pytest.raises(WireError):
        decode_act(pack((*raw, {"a": 1.0}, {"a": 1.0})))
