"""Ten storms of a fixed seed; `python -m tests.storm` has more."""

from pathlib import Path
from random import Random

import pytest

from tests.storm.judge import play_and_judge
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

SEED = 7


@pytest.mark.parametrize("number", first_of(range(10)))
def test_whatever_is_done_to_a_run_it_ends_well(number: int, tmp_path: Path) -> None:
    """In time, with nothing left, and with records that agree."""
    seen, found = play_and_judge(tmp_path, Random(f"{SEED}/{number}"))
    assert found == [], (seen.landed, seen.printed)
