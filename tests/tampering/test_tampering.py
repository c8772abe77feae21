"""What is changed in a stored result is refused, found or harmless; `python -m tests.tampering` has any number."""

from pathlib import Path

import pytest

from tests.tampering.changes import judge
from tests.tampering.stores import make_all

pytestmark = [pytest.mark.processes, pytest.mark.slow]

PLACES, SEED = 2000, 7


def test_no_place_of_a_stored_result_changes_unseen(tmp_path: Path) -> None:
    """In 2,000 places of runs, recordings, checkpoints, sweeps, studies, sessions and their tables."""
    counts, wrong = judge(make_all(tmp_path), PLACES, SEED)
    assert wrong == []
    assert sum(count.total() for count in counts.values()) == PLACES
    assert all(count["refused"] + count["found"] > count["harmless"] for count in counts.values()), counts
