"""The table of the air's models: what is on is built, in order, each with a generator of its own."""

import re
from pathlib import Path

from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.plugins import RADIO_MODELS
from deltaswarm_world.core.air.channel.model import models_of
from deltaswarm_world.core.air.channel.reach import RangeDisc
from tests.support.airs import EVERYTHING


def test_a_model_is_built_only_where_the_scenario_asks_for_it() -> None:
    """None by default; all of them, in the order of the table, where every model is on."""
    assert models_of(Scenario(), RangeDisc(9.0)) == []
    models = models_of(load_scenario("smoke", [*EVERYTHING]), RangeDisc(9.0))
    assert [model.reason for model in models] == list(RADIO_MODELS.shipped)


def test_no_stream_of_chance_is_used_twice() -> None:
    """Two uses of one number would draw the same values."""
    sources = [path.read_text() for path in (Path(__file__).parents[3] / "world").rglob("*.py")]
    assigned = [
        stream
        for source in sources
        for numbers in re.findall(r"^(?:[A-Z_, ]+_STREAM|    stream) = ([\d, ]+)$", source, re.MULTILINE)
        for stream in numbers.split(", ")
    ]
    assert len(assigned) > 15
    assert len(assigned) == len(set(assigned))
