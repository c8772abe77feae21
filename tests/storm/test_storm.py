"""Ten storms of a fixed seed; `python -m tests.storm` has more."""

from pathlib import Path
from random import Random

import pytest

from tests.storm.judge import play_and_judge

pytestmark = pytest.mark.processes

SEED = 7


@pytest.mark.parametrize("number", [0, *(pytest.param(number, marks=pytest.mark.slow) for number in range(1, 10))])
def test_whatever_is_done_to_a_run_it_ends_well(number: int, tmp_path: Path) -> None:
    """In time, with nothing left, and with records that agree."""
    seen, found = play_and_judge(tmp_path, Random(f"{SEED}/{number}"))
    assert found == [], (seen.landed, seen.printed)
