"""What tests of studies have in common."""

import pytest

from deltaswarm_orchestrator.base import provenance


@pytest.fixture(autouse=True)
def committed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the code count as committed, so that studies can be frozen while somebody works on it."""
    monkeypatch.setattr(provenance, "uncommitted", list)
