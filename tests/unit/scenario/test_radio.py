"""Settings of the radio and of the uplink: off by default, and each mistake is one clear message."""

from pathlib import Path
from typing import Any

import pytest
from docs.extensions.scenario_keys import reference
from hypothesis import given

from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.operator_links import LEAST_REPORT_BYTES, UplinkSettings
from deltaswarm_scenario.radio import LEAST_FRAME_BYTES, RadioSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.access import world_rules
from deltaswarm_wire.checked import load, plain
from deltaswarm_wire.envelope import Sample, encode_sample
from deltaswarm_wire.keys import Keys
from deltaswarm_wire.operator_messages import Report, encode_report
from tests.support.airs import EVERYTHING, radios
from tests.support.complaints import mistakes
from tests.support.tiers import in_one_test


@in_one_test(
    ("table", "said"),
    [
        ({"loss": -0.1}, ("radio.loss", "-0.1")),
        ({"duplication": 1.5}, ("radio.duplication", "1.5")),
        ({"burst": {"p_good_to_bad": 2}}, ("radio.burst.p_good_to_bad", "2")),
        ({"burst": {"loss_bad": 7}}, ("radio.burst.loss_bad", "7")),
        ({"walls": [{"a_m": [0, 0], "b_m": [1, "x"]}]}, ("radio.walls[0].b_m[1]", "'x'")),
        ({"burst": {"p_good_to_bad": 0.1, "p_bad_to_good": 0}}, ("radio.burst.p_bad_to_good", "0")),
        ({"latency_s": -1}, ("radio.latency_s", "-1")),
        ({"bandwidth": {"queue_bytes": -1}}, ("radio.bandwidth.queue_bytes", "-1")),
        ({"bandwidth": {"sender_bytes_per_s": 3, "queue_bytes": 4}}, ("radio.bandwidth.sender_bytes_per_s", "3")),
        ({"reception": "dics"}, ("radio.reception", "'dics'; did you mean 'disc'?")),
        ({"path_loss": {"sensitivity_dbm": -30}}, ("radio.path_loss.sensitivity_dbm", "-30")),
        ({"ranges": [{"agents": [5], "range_m": 3}]}, ("radio.ranges[0].agents", "5")),
        ({"ranges": [{"agents": [1]}, {"agents": [1]}]}, ("radio.ranges[1].agents", "1 again")),
        ({"ranges": [{}]}, ("radio.ranges[0].agents", "none")),
        ({"ranges": [{"agents": [1], "range_m": 0}]}, ("radio.ranges[0].range_m", "0")),
        ({"walls": [{"a_m": [5, 5], "b_m": [5, 5]}]}, ("radio.walls[0].b_m", "[5.0, 5.0]")),
        ({"walls": [{"a_m": [-1, 0], "b_m": [-1, 100]}]}, ("radio.walls[0]", "[-1.0, 0.0] to [-1.0, 100.0]")),
        ({"walls": [{"a_m": [0, 0], "b_m": [5, 5], "from_s": 9, "until_s": 9}]}, ("radio.walls[0].until_s", "9")),
        ({"blackouts": [{}, {"from_s": 9, "until_s": 3}]}, ("radio.blackouts[1].until_s", "3")),
        ({"jammers": [{"center_m": [108, 108]}]}, ("radio.jammers[0]", "[108.0, 108.0], 10 m")),
        ({"jammers": [{"center_m": [5, 5], "radius_m": -3}]}, ("radio.jammers[0].radius_m", "-3")),
        ({"jammers": [{"center_m": [5]}]}, ("radio.jammers[0].center_m", "[5]")),
        (
            {"jammers": [{"waypoints_m": [[1, 2], [3, 4]], "times_s": [5]}]},
            ("radio.jammers[0].times_s", "1 for 2 waypoints"),
        ),
        (
            {"jammers": [{"waypoints_m": [[1, 2], [3, 4]], "times_s": [5, 5]}]},
            ("radio.jammers[0].times_s", "[5.0, 5.0]"),
        ),
        ({"jammers": [{"from_s": 6, "waypoints_m": [[1, 2]], "times_s": [5]}]}, ("radio.jammers[0].times_s", "[5.0]")),
        (
            {"jammers": [{"waypoints_m": [[1, 2, 3]], "times_s": [5]}]},
            ("radio.jammers[0].waypoints_m[0]", "[1.0, 2.0, 3.0]"),
        ),
        ({"jammer": []}, ("radio.jammer", "unknown key")),
        ({"walls": {}}, ("radio.walls", "{}")),
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
def test_a_mistake_gives_one_clear_message(table: dict[str, Any], said: tuple[str, str]) -> None:
    part = said[0].partition(".")[0]
    assert mistakes({"agents": {"count": 5}, part: table}) == [said]


@pytest.mark.parametrize(
    "jammer",
    [
        {"center_m": [-6, -6], "radius_m": 9},
        {"center_m": [-60, 50], "waypoints_m": [[160, 50]], "times_s": [9], "radius_m": 1},
        {"center_m": [-60, 110], "waypoints_m": [[160, 110]], "times_s": [9], "radius_m": 10},
    ],
)
def test_a_zone_that_touches_the_arena_is_none_outside(jammer: dict[str, Any]) -> None:
    assert load(Scenario, {"radio": {"jammers": [jammer]}}).radio.jammers


@given(radios)
def test_any_air_survives_the_way_through_a_table(table: dict[str, Any]) -> None:
    scenario = load(Scenario, {"radio": table})
    assert load(Scenario, plain(scenario)) == scenario


def test_everything_at_once_is_a_scenario_file(tmp_path: Path) -> None:
    scenario = load_scenario("smoke", EVERYTHING)
    (tmp_path / "all.toml").write_text(to_toml(scenario))
    assert load_scenario(str(tmp_path / "all.toml")) == scenario


def test_no_frame_is_shorter_than_the_least() -> None:
    assert len(encode_sample(Sample(0, b""))) == LEAST_FRAME_BYTES


def test_the_reference_names_the_keys_of_tables_in_lists() -> None:
    for key in ("burst.p_good_to_bad", "walls[].a_m", "jammers[].waypoints_m", "ranges[].agents"):
        assert f"| `radio.{key}` |" in reference()


def test_all_is_off_by_default() -> None:
    radio = RadioSettings()
    assert (radio.ranges, radio.walls, radio.jammers, radio.blackouts) == ((), (), (), ())
    assert (radio.burst.is_on, radio.asymmetry.dead_share, radio.asymmetry.range_factor_low) == (False, 0, 1)
    assert (radio.loss, radio.latency_s, radio.jitter_s, radio.duplication, radio.contention_bytes_per_s) == (0,) * 5
    assert (radio.bandwidth.sender_bytes_per_s, radio.bandwidth.receiver_bytes_per_s) == (0, 0)


@in_one_test(
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
def test_any_piece_turns_the_uplink_on(uplink: dict[str, Any]) -> None:
    made = load(UplinkSettings, uplink)
    assert made.is_on
    assert load(UplinkSettings, plain(made)) == made
    assert not UplinkSettings().is_on


def test_no_report_is_shorter_than_the_bound() -> None:
    assert len(encode_report(Report(0, 0, 0, "root", 0.0, 0.0, 0, ()))) == LEAST_REPORT_BYTES


def test_the_operator_hears_the_world_and_no_agent() -> None:
    keys = Keys("r")
    rules = world_rules(keys, range(3))["rules"]
    allowed = {rule["id"]: rule["key_exprs"] for rule in rules}
    assert allowed["operator-receives"] == [keys.forwarded, keys.clock]
    assert not any(keys.forwarded in exprs for name, exprs in allowed.items() if name.endswith("-sends"))
