"""Sessions of unit tests do their runs without pages and processes."""

import pytest

from deltaswarm_serving import alone
from tests.support.sessions import run_here


@pytest.fixture(autouse=True)
def _without_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alone, "serve", run_here)
