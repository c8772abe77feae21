"""What is told of a run while it goes on."""

import re
from types import SimpleNamespace

import pytest

from deltaswarm_orchestrator.run import progress
from deltaswarm_orchestrator.run.progress import Display
from deltaswarm_wire.operator_messages import Status


def test_a_speed_is_told_when_there_was_time_to_measure_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the first state it is not known; later it is what was simulated since, by the wall clock."""
    told = []
    with Display(step_s=1.0, agents=25) as display:
        for now, time_s in ((100.0, 49.0), (100.1, 149.0), (120.0, 849.0)):
            monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda now=now: now))
            phase = "ended" if now == 100.1 else "running"  # which is told at once, whenever it is
            display.update(Status(int(time_s), 9000, time_s, 25, 0, 1.0, 0, 0, phase), None)
            told.append(re.findall(r", (\S+) real time", capsys.readouterr().err))
    assert told == [[], [], ["40x"]]


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_on_a_narrow_terminal_the_bar_and_the_time_left_stay(width: int) -> None:
    """What does not fit beside them is left out, the total time last."""
    status = Status(4500, 9000, 4500.0, 25, 12, 33.3, 9, 210, "running")
    text = progress.fitting(progress.described(status, 4.2, 40.0, 1.0), width - progress.BAR_AND_TIME)
    assert text.startswith("4500/9000 s")
    assert len(text) <= max(width - progress.BAR_AND_TIME, len("4500/9000 s"))
    assert ("waiting" in text) == (width >= 120)
