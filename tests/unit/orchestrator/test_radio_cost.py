"""What the radio models cost: the variants are what they say, and take turns."""

from dataclasses import fields

import pytest

from benchmarks import radio_cost
from benchmarks.__main__ import main
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.radio import RadioSettings


@pytest.mark.parametrize("table", [radio_cost.ALL_ON, radio_cost.ALWAYS_ON], ids=["on", "always on"])
def test_on_is_every_model(table: tuple[str, ...]) -> None:
    """Each key of `[radio]` is other than it is by default, but the range of a disc and models from outside."""
    radio, plain = load_scenario("paper-25", table).radio, load_scenario("paper-25").radio
    assert [one.name for one in fields(RadioSettings) if getattr(radio, one.name) == getattr(plain, one.name)] == [
        "range_m",
        "models",
    ]


def test_a_wall_and_a_jammer_last() -> None:
    """To the end of any run; a blackout does not, or nobody would hear anything."""
    radio = radio_cost.radio_scenario(25, 100, 1, radio_cost.ALWAYS_ON).radio
    assert {zone.until_s for zone in (*radio.walls, *radio.jammers)} == {None}
    assert radio.blackouts[0].until_s is not None
    assert radio.blackouts[0].until_s < radio_cost.WARM_UP_STEPS


def test_the_variants_are_measured_side_by_side() -> None:
    """With all models on the same swarm sends and hears otherwise."""
    found = radio_cost.measure(agents=5, steps=60, rounds=1)
    plain, on = (found["variants"][name] for name in ("plain", "all_on"))
    assert plain["share_of_plain"] == 1.0
    assert on["share_of_plain"] == pytest.approx(plain["step_us"] / on["step_us"])
    for count in ("frames_sent", "frames_received"):
        assert plain[count] != on[count]
    for row in (plain, on):
        assert row["steps_per_s"] == pytest.approx(1e6 / row["step_us"])
        assert 0 < row["agents_us"] < row["step_us"]


def test_two_agents_are_too_few() -> None:
    """Before anything is run; the command ends with 2."""
    with pytest.raises(ValueError, match="at least 3"):
        radio_cost.measure(2, 10, 1)
    assert main(["radio", "--agents=2", "--steps=10", "--rounds=1"]) == 2
