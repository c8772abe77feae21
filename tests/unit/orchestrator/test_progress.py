"""What is told of a run while it goes on."""

import re
import sys
import types
from types import SimpleNamespace

import pytest

from deltaswarm_orchestrator.run import progress
from deltaswarm_orchestrator.run.progress import Bar, Display
from deltaswarm_orchestrator.sweeps.engine import Done
from deltaswarm_orchestrator.sweeps.runner import SweepDisplay
from deltaswarm_wire.operator_messages import Status
from tests.support.complaints import Printed
from tests.support.sweeping import made, tasks_of
from tests.support.tiers import in_one_test


def test_a_speed_is_told_when_there_was_time_to_measure_it(monkeypatch: pytest.MonkeyPatch, capsys: Printed) -> None:
    """Of the first state it is not known; later it is what was simulated since, by the wall clock."""
    told = []
    with Display(step_s=1.0, agents=25) as display:
        for now, time_s in ((100.0, 49.0), (100.1, 149.0), (120.0, 849.0)):
            monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda now=now: now))
            phase = "ended" if now == 100.1 else "running"  # which is told at once, whenever it is
            display.update(Status(int(time_s), 9000, time_s, 25, 0, 1.0, 0, 0, phase), None)
            told.append(re.findall(r", (\S+) real time", capsys.readouterr().err))
    assert told == [[], [], ["40x"]]


@in_one_test("width", [40, 60, 80, 120])
def test_on_a_narrow_terminal_the_bar_and_the_time_left_stay(width: int) -> None:
    """What does not fit beside them is left out, the total time last."""
    status = Status(4500, 9000, 4500.0, 25, 12, 33.3, 9, 210, "running")
    text = progress.fitting(progress.described(status, 4.2, 40.0, 1.0), width - progress.BAR_AND_TIME)
    assert text.startswith("4500/9000 s")
    assert len(text) <= max(width - progress.BAR_AND_TIME, len("4500/9000 s"))
    assert ("waiting" in text) == (width >= 120)


def test_a_sweep_counts_what_was_there_what_ended_and_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Failed runs have ended too; the last one is told at once."""
    told = []
    with SweepDisplay("mine") as display:
        monkeypatch.setattr(display, "_show", lambda line, **state: told.append((line, state)))
        display.announce(5, 2)
        for index, task in enumerate(tasks_of(made({"axes": {"radio.loss": [0.0, 0.1, 0.2]}, "repeats": 1}))):
            display.count(Done(task, None if index == 1 else {}))
    assert [(state["completed"], state["total"], state["is_last"]) for _, state in told] == [
        (1, 3, False),
        (2, 3, False),
        (3, 3, True),
    ]
    assert [re.findall(r"(\d) of (\d)", line) for line, _ in told] == [[("3", "5")], [("4", "5")], [("5", "5")]]
    assert ["1 failed" in line for line, _ in told] == [False, True, True]


def test_a_notebook_shows_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """One output, which is replaced as the run goes on; text from outside cannot break its markup."""
    shown: list[dict[str, str]] = []

    class Handle:
        def update(self, data: dict[str, str], raw: bool) -> None:
            shown.append(data)

    def display(data: dict[str, str], raw: bool, display_id: bool) -> Handle:
        shown.append(data)
        return Handle()

    notebook = types.ModuleType("IPython.display")
    notebook.display = display  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", notebook)
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    with Bar("<b>") as bar:
        bar._show("1 of 4 & more", is_last=False, brief="1", completed=1, total=4)
    assert [data["text/html"] for data in shown] == [
        "<progress></progress> &lt;b&gt;",
        '<progress value="1" max="4"></progress> 1 of 4 &amp; more',
    ]
    assert shown[-1]["text/plain"] == "1 of 4 & more"
