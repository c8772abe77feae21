"""The pages that are made from the code are what the code makes."""

from pathlib import Path

from docs.extensions.scenario_keys import reference

ROOT = Path(__file__).parents[2]


def test_the_page_of_scenario_keys_is_up_to_date() -> None:
    """docs/SCENARIO.md is what `reference` writes: every key, default, meaning and source."""
    assert (ROOT / "docs" / "SCENARIO.md").read_text() == reference()
