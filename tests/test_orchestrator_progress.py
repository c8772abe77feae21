"""What is told of a run while it goes on."""

import re
from types import SimpleNamespace

import pytest

from deltaswarm_orchestrator.run import progress
from deltaswarm_orchestrator.run.progress import Display
from deltaswarm_wire.messages import Status


def test_a_speed_is_told_when_there_was_time_to_measure_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the first state it is not known; later it is what was simulated since, by the wall clock."""
    told = []
    with Display(step_s=1.0) as display:
        for now, time_s in ((100.0, 49.0), (100.1, 149.0), (120.0, 849.0)):
            monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda now=now: now))
            phase = "ended" if now == 100.1 else "running"  # which is told at once, whenever it is
            display.update(Status(int(time_s), 9000, time_s, 25, 0, 1.0, phase), None)
            told += re.findall(r", (\S+) real time", capsys.readouterr().err)
    assert told == ["-x", "-x", "40x"]
