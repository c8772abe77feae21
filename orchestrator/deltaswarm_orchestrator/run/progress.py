"""Progress of a run: a bar on a terminal or in a notebook, else a line on standard error every few seconds."""

import html
import importlib
import sys
import time
from collections.abc import Sequence
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from deltaswarm_orchestrator.base.exits import Reporter, shown
from deltaswarm_orchestrator.results.summary import main_rows
from deltaswarm_wire.operator_messages import Status

LINE_EVERY_S = 10.0
SPEED_OVER_S = 0.5
"""Minimum wall time over which a speed is measured [s]; over less it would be meaningless."""

BAR_AND_TIME = 24
"""Minimum number of columns for the bar and the time left."""


class Bar:
    """A progress bar on a terminal or in a notebook, or a line every LINE_EVERY_S on a pipe; a context manager."""

    def __init__(self, text: str, *columns: ProgressColumn, **options: Any) -> None:
        self._console = Console(stderr=True)
        self._bar: Progress | None = None
        if self._console.is_terminal:
            self._bar = Progress(TextColumn("{task.description}"), *columns, console=self._console, **options)
        self._task = self._bar.add_task(text, total=None) if self._bar else TaskID(0)
        self._line_due = 0.0
        self._cell: Any = None
        """What shows the bar in a notebook."""
        if self._console.is_jupyter:
            display = importlib.import_module("IPython.display").display
            self._cell = display(_in_notebook(text), raw=True, display_id=True)

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _show(self, line: str, *, is_last: bool, brief: str, **task: Any) -> None:
        """Show a state: `brief` beside the bar, or print `line` if one is due."""
        now = time.monotonic()
        if self._bar is not None:
            self._bar.update(self._task, description=brief, **task)
        elif self._cell is not None:
            self._cell.update(_in_notebook(line, task.get("completed"), task.get("total")), raw=True)
        elif now >= self._line_due or is_last:
            self._line_due = now + LINE_EVERY_S
            print(line, file=sys.stderr, flush=True)


def _in_notebook(text: str, completed: float | None = None, total: float | None = None) -> dict[str, str]:
    """Return a bar with its text, as a notebook shows it."""
    state = "" if completed is None or not total else f' value="{completed:g}" max="{total:g}"'
    return {"text/plain": text, "text/html": f"<progress{state}></progress> {html.escape(text)}"}


class Display(Bar, Reporter):
    def __init__(self, step_s: float, agents: int) -> None:
        columns = BarColumn(bar_width=None), TimeRemainingColumn()
        super().__init__("waiting for all processes", *columns, expand=True)
        self._agents = agents
        self._step_s = step_s
        self._first: tuple[float, float] | None = None
        """Wall time and simulated time [s] of the first state shown."""
        self._shown: Status | None = None

    def say(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def update(self, status: Status, messages_per_s: float | None) -> None:
        if status.phase == "waiting":
            if self._bar is not None:
                self._bar.update(self._task, description=f"{status.agents_alive} of {self._agents} agents are up")
            return
        if status == self._shown:
            return
        self._shown = status
        now = time.monotonic()
        if self._first is None:
            self._first = now, status.time_s
        passed_s = now - self._first[0]
        speed = (status.time_s - self._first[1]) / passed_s if passed_s >= SPEED_OVER_S else None
        parts = described(status, messages_per_s, speed, self._step_s)
        brief = fitting(parts, self._console.width - BAR_AND_TIME)
        task = {"total": status.steps, "completed": status.step + 1}
        self._show(", ".join(parts), is_last=status.phase == "ended", brief=brief, **task)


def described(status: Status, messages_per_s: float | None, speed: float | None, step_s: float) -> list[str]:
    """Describe a status: simulated time, speed, workload, trees, waiting, events; most important first."""
    return [
        f"{status.time_s:.0f}/{status.steps * step_s:.0f} s",
        *([f"{speed:.0f}x real time"] if speed is not None else []),
        f"operator {'-' if messages_per_s is None else f'{messages_per_s:.1f}'} messages/s",
        f"{status.agents_in_trees} of {status.agents_alive} in trees",
        f"waiting {status.mean_waiting_s:.1f} s",
        f"{status.events_completed} events complete, {status.events_open} open",
    ]


def fitting(parts: Sequence[str], room: int) -> str:
    """Join as many parts as fit into `room` columns, at least the first."""
    texts = [", ".join(parts[:count]) for count in range(len(parts), 0, -1)]
    return next((text for text in texts if len(text) <= room), texts[-1])


def result_table(summary: dict[str, Any]) -> Table:
    table = Table(title=f"{summary['name']}, {summary['mode']}, seed {summary['seed']}", show_header=False)
    table.add_column(style="dim")
    table.add_column(justify="right")
    table.add_column(style="dim")
    for title, value, unit in main_rows(summary):
        table.add_row(title, shown(value), unit)
    return table
