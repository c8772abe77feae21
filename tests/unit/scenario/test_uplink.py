"""The uplink's settings: off by default, and a mistaken table is one clear message each."""

from typing import Any

import pytest

from deltaswarm_scenario.operator_links import LEAST_REPORT_BYTES, UplinkSettings
from deltaswarm_wire.access import world_rules
from deltaswarm_wire.checked import load, plain
from deltaswarm_wire.keys import Keys
from deltaswarm_wire.operator_messages import Report, encode_report
from tests.support.complaints import mistakes


@pytest.mark.parametrize(
    ("uplink", "said"),
    [
        ({"loss": -0.1}, ("uplink.loss", "-0.1")),
        ({"los": 0.1}, ("uplink.los", "unknown key")),
        ({"latency_s": -1}, ("uplink.latency_s", "-1")),
        ({"burst": {"p_good_to_bad": 0.1, "p_bad_to_good": 0}}, ("uplink.burst.p_bad_to_good", "0")),
        ({"outages": [{"from_s": 9, "until_s": 3}]}, ("uplink.outages[0].until_s", "3")),
        ({"base_m": [5, 5]}, ("uplink.range_m", "nothing")),
        ({"range_m": 5}, ("uplink.range_m", "5")),
        ({"relay": True}, ("uplink.relay", "true")),
        ({"base_m": [5], "range_m": 5}, ("uplink.base_m", "[5]")),
        ({"base_m": [5, 5], "range_m": 0}, ("uplink.range_m", "0")),
        ({"base_m": [5, 100.5], "range_m": 5}, ("uplink.base_m", "[5.0, 100.5]")),
        ({"bandwidth": {"receiver_bytes_per_s": 3, "queue_bytes": 5}}, ("uplink.bandwidth.receiver_bytes_per_s", "3")),
    ],
)
def test_a_mistake_is_named(uplink: dict[str, Any], said: tuple[str, str]) -> None:
    """With its path and value."""
    assert mistakes({"uplink": uplink}) == [said]


@pytest.mark.parametrize(
    "uplink",
    [
        {"loss": 0.1},
        {"burst": {"p_good_to_bad": 0.1}},
        {"latency_s": 1},
        {"jitter_s": 1},
        {"bandwidth": {"sender_bytes_per_s": 100}},
        {"bandwidth": {"receiver_bytes_per_s": 100}},
        {"outages": [{"from_s": 3}]},
        {"base_m": [0, 0], "range_m": 5, "relay": True},
    ],
)
def test_any_piece_turns_it_on(uplink: dict[str, Any]) -> None:
    """Without one it is off; and a table survives being written and read."""
    made = load(UplinkSettings, uplink)
    assert made.is_on
    assert load(UplinkSettings, plain(made)) == made
    assert not UplinkSettings().is_on


def test_no_report_is_shorter_than_the_bound() -> None:
    """The smallest one is as long."""
    assert len(encode_report(Report(0, 0, 0, "root", 0.0, 0.0, 0, ()))) == LEAST_REPORT_BYTES


def test_the_operator_hears_the_world_and_no_agent() -> None:
    """And no agent may send as the world."""
    keys = Keys("r")
    rules = world_rules(keys, range(3))["rules"]
    allowed = {rule["id"]: rule["key_exprs"] for rule in rules}
    assert allowed["operator-receives"] == [keys.forwarded, keys.clock]
    assert not any(keys.forwarded in exprs for name, exprs in allowed.items() if name.endswith("-sends"))
