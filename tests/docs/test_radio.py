"""The page on radio: its models and their order are the code's, and it names every key."""

import dataclasses
import re
from pathlib import Path

import pytest

from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import UPLINK_REASONS
from deltaswarm_world.core.air.channel.model import models_of
from deltaswarm_world.core.air.channel.reach import RangeDisc
from tests.support.airs import EVERYTHING

PAGE = (Path(__file__).parents[2] / "docs" / "RADIO.md").read_text()


def test_the_link_models_are_listed_in_the_order_of_the_code() -> None:
    """Each with its class and the reason that is counted."""
    models = models_of(load_scenario("smoke", [*EVERYTHING]), RangeDisc(9.0))
    rows = re.findall(r"^\| (\d) \| `(\w+)` \| `(\w+)` \|", PAGE, re.MULTILINE)
    assert rows == [(str(n), type(model).__name__, model.reason) for n, model in enumerate(models, start=1)]


def test_every_reason_of_the_uplink_is_named() -> None:
    uplink = PAGE.split("## Uplink")[1].split("## Downlink")[0]
    assert [reason for reason in UPLINK_REASONS if f"`{reason}`" not in uplink] == []


@pytest.mark.parametrize("table", ["radio", "uplink", "downlink"])
def test_every_key_is_named(table: str) -> None:
    """Of the first level: a table's own keys are in docs/SCENARIO.md."""
    keys = [f"{table}.{spec.name}" for spec in dataclasses.fields(getattr(Scenario(), table))]
    assert [key for key in keys if f"`{key}" not in PAGE] == []
