"""A board's memory does not grow with time: the short version of `python -m tests.support.soak`."""

from pathlib import Path

import pytest

from tests.support.soak import LOSS_EVERY_S, soak

pytestmark = [pytest.mark.slow, pytest.mark.processes]


def test_memory_does_not_grow_with_time(tmp_path: Path) -> None:
    """Two simulated hours, with links that come and go; nothing grows after the first loss, which needs memory once."""
    rows = soak(tmp_path, hours=2.0, accelerate=400.0, samples=8)
    early, last = next(row for row in rows if row[0] * 3600 > LOSS_EVERY_S), rows[-1]
    assert all(after - before < 1.0 for before, after in zip(early[1:], last[1:], strict=True)), rows
    assert max(last[1:]) <= 40.0
    for agent in range(3):
        logs = list((tmp_path / "logs").glob(f"agent-{agent}.log*"))
        assert 1 <= len(logs) <= 4
        assert sum(file.stat().st_size for file in logs) <= 4 * 100_000
