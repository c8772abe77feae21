"""What tests of studies have in common."""

import pytest

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.processes.elsewhere import PYTHON
from deltaswarm_studies import checking


@pytest.fixture(autouse=True)
def committed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the code count as committed, so that studies can be frozen while somebody works on it."""
    monkeypatch.setattr(provenance, "uncommitted", list)


@pytest.fixture
def checked_by_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let rows be repeated by the Python engine, since the dense one must first be compiled for minutes."""
    monkeypatch.setattr(checking, "other_engine", lambda *_: PYTHON)
