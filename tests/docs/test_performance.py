"""The page on performance: its model to compare with works."""

import re
import subprocess
import sys

import pytest

from tests.support.pages import ROOT


def test_the_mesa_model_does_the_task() -> None:
    """In a tenth of a run events arrive at the scenario's rate, and most are completed."""
    pytest.importorskip("mesa")
    command = [sys.executable, str(ROOT / "docs" / "performance" / "mesa_model.py"), "900", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = re.fullmatch(r"[\d.]+ s, \d+ steps/s, (\d+) events, (\d+) completed\n", done.stdout)
    assert found, done.stdout
    events, completed = map(int, found.groups())
    assert 25 <= events <= 65
    assert completed > events / 3
