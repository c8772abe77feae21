"""The developers' measurements: one density at any size, variants in turns, rows for each size."""

import itertools
import json
import math
from dataclasses import fields

import pytest
from benchmarks import coverage, processes, radio_cost, scale
from benchmarks.__main__ import main
from benchmarks.rounds import median_of

from deltaswarm_orchestrator.processes.starter import LEASE, OTHER_SESSIONS, STARTED, room_for
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.radio import RadioSettings
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test


@in_one_test(("agents", "tiles"), [(1, 1), (25, 1), (30, 1), (50, 2), (100, 4), (200, 8), (400, 16)])
def test_every_size_has_the_papers_density(agents: int, tiles: int) -> None:
    """Of agents and of events; each tile has its own gaussian, and all tiles are alike."""
    made = scale.scale_scenario(agents, 100)
    area_m2 = made.arena.width_m * made.arena.height_m
    assert made.agents.count == agents
    assert agents / area_m2 == pytest.approx(processes.AGENTS_PER_M2)
    assert made.events.rate_hz / agents == pytest.approx(0.05 / 25)
    assert made.run.steps == 100
    assert made.problems() == []
    means = [component.mean_m for component in made.events.density.components]
    assert len(set(means)) == tiles
    side_m = (area_m2 / tiles) ** 0.5
    for (x_m, y_m), (other_x_m, other_y_m) in itertools.combinations(means, 2):
        assert max(abs(x_m - other_x_m), abs(y_m - other_y_m)) > 0.999 * side_m


@pytest.mark.processes
def test_growth_is_measured_between_sizes() -> None:
    """Speed, trees and memory of each size, and the exponent of the time of a step."""
    found = scale.measure((5, 20), 30, 1)
    assert [row["agents"] for row in found["sizes"]] == [5, 20]
    for row in found["sizes"]:
        assert row["agent_steps_per_s"] == pytest.approx(row["agents"] * row["steps_per_s"])
        assert 0 <= row["share_in_trees"] <= 1
        assert row["world_us_per_agent"] + row["agents_us_per_agent"] == pytest.approx(row["us_per_agent"])
        assert row["us_per_asked_agent"] * row["share_asked"] == pytest.approx(row["us_per_agent"])
        assert 10 < row["peak_memory_mb"] < 1000
    small, large = (row["steps_per_s"] for row in found["sizes"])
    assert found["step_time_exponent"] == pytest.approx(math.log(small / large) / math.log(20 / 5))


def test_a_median_is_of_the_rounds_in_which_it_was_measured() -> None:
    """None only if there is no such round."""
    rows = [{"a": 1.0, "b": None, "c": None}, {"a": 2.0, "b": 5.0, "c": None}]
    assert median_of(rows) == {"a": 1.5, "b": 5.0, "c": None}


def test_radio_cost_turns_every_model_on() -> None:
    """Each key of `[radio]` differs from its default, but the range of a disc and models from outside."""
    radio, plain = load_scenario("paper-25", radio_cost.ALWAYS_ON).radio, load_scenario("paper-25").radio
    same = [one.name for one in fields(RadioSettings) if getattr(radio, one.name) == getattr(plain, one.name)]
    assert same == ["range_m", "models"]
    assert {zone.until_s for zone in (*radio.walls, *radio.jammers)} == {None}  # they last; a blackout does not
    assert (radio.blackouts[0].until_s or math.inf) < radio_cost.WARM_UP_STEPS


def test_the_variants_of_the_radio_are_measured_side_by_side() -> None:
    """With all models on the same swarm sends and hears otherwise."""
    found = radio_cost.measure(agents=5, steps=60, rounds=1)
    plain, on = (found["variants"][name] for name in ("plain", "all_on"))
    assert on["share_of_plain"] == pytest.approx(plain["step_us"] / on["step_us"])
    for count in ("frames_sent", "frames_received"):
        assert plain[count] != on[count]
    for row in (plain, on):
        assert row["steps_per_s"] == pytest.approx(1e6 / row["step_us"])
        assert 0 < row["agents_us"] < row["step_us"]


def test_coverage_tells_when_half_of_the_agents_know() -> None:
    """From the command on, in seconds; None if they never do."""
    found = coverage.measure(1, ranges_m=[None])
    assert [row["loss"] for row in found["rows"]] == list(coverage.LOSSES)
    for row, curve in zip(found["rows"], found["shares"], strict=True):
        assert row["known_at_end"] == curve[-1]
        if (half_s := row["50%_know_after_s"]) is not None:
            assert curve[int(half_s)] >= 0.5
            assert half_s == 0 or curve[int(half_s) - 1] < 0.5


@pytest.mark.processes
def test_runs_of_processes_are_measured(capsys: Printed) -> None:
    """A row for each size, with the world's phases; no process is left on Python's list."""
    assert main(["processes", "--sizes=6,3", "--steps=20", "--rounds=1"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["agents"] for row in found["sizes"]] == [6, 3]
    for row in found["sizes"]:
        assert row["steps_per_s"] > 0
        assert 1 < row["median_pss_mb"] <= row["pss_mb"] < 50
        assert row["open_files"] > 3 * row["agents"]
    assert all(row["frames_us"] > 0 and row["frames_cpu_us"] > 0 for row in found["phases"])
    assert not STARTED


def test_a_thousand_agents_and_more_may_join_at_once() -> None:
    """Beyond Zenoh's own limits on sessions and handshakes."""
    settings = dict(room_for(1500))
    for name in ("max_sessions", "accept_pending"):
        assert settings[f"transport/unicast/{name}"] == str(1500 + OTHER_SESSIONS)
    assert int(settings[LEASE]) == 90_000  # a link may be silent while the others start
    assert LEASE not in dict(room_for(100))
