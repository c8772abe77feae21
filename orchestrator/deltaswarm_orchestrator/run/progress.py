"""How a run goes, for people: a bar on a terminal, a line now and then on a pipe. On standard error."""

import sys
import time
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from deltaswarm_wire.operator_messages import Status

LINE_EVERY_S = 10.0
SPEED_OVER_S = 0.5
"""Wall time over which a speed is measured at the least; what is shorter says nothing."""


BAR_AND_TIME = 24
"""Columns that the bar and the time left need at least."""


class BarOnTerminal:
    """What has a bar, or none where there is no terminal, and takes it away at its end."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._bar: Progress | None = None
        self._task = TaskID(0)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()


class Display(BarOnTerminal):
    """A bar on a terminal, else lines; as a context manager."""

    def __init__(self, step_s: float, agents: int) -> None:
        super().__init__()
        self._agents = agents
        self._step_s = step_s
        self._first: tuple[float, float] | None = None
        """Wall time and simulated time [s] of the first state that was shown."""
        self._line_due = 0.0
        self._shown: Status | None = None

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            columns = TextColumn("{task.description}"), BarColumn(bar_width=None), TimeRemainingColumn()
            self._bar = Progress(*columns, console=self._console, expand=True)
            self._task = self._bar.add_task("waiting for all processes", total=None)
            self._bar.start()
        return self

    def say(self, text: str) -> None:
        """Print it at once."""
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def update(self, status: Status, messages_per_s: float | None) -> None:
        """Show the newest state."""
        now = time.monotonic()
        if status.phase == "waiting" and self._bar is not None:
            self._bar.update(self._task, description=f"{status.agents_alive} of {self._agents} agents are up")
        if status.phase == "waiting" or status == self._shown:
            return
        self._shown = status
        if self._first is None:
            self._first = now, status.time_s
        passed_s = now - self._first[0]
        speed = (status.time_s - self._first[1]) / passed_s if passed_s >= SPEED_OVER_S else None
        if self._bar is not None:
            room = self._console.width - BAR_AND_TIME
            text = describe_briefly(status, messages_per_s, speed, self._step_s, room)
            self._bar.update(self._task, description=text, total=status.steps, completed=status.step + 1)
        elif now >= self._line_due or status.phase == "ended":
            self._line_due = now + LINE_EVERY_S
            print(describe(status, messages_per_s, speed, self._step_s), file=sys.stderr, flush=True)


def describe(status: Status, messages_per_s: float | None, speed: float | None, step_s: float) -> str:
    """One line: simulated time, speed against real time, trees, workload, waiting."""
    return (
        f"{status.time_s:.0f}/{status.steps * step_s:.0f} s, {_speed(speed, ' real time, ')}"
        f"{status.agents_alive} agents, {status.agents_in_trees} in trees, "
        f"operator {_rate(messages_per_s)} messages/s, waiting {status.mean_waiting_s:.1f} s"
    )


def describe_briefly(
    status: Status, messages_per_s: float | None, speed: float | None, step_s: float, room: int
) -> str:
    """The same beside a bar: as much of it as there is room for, the time first."""
    parts = (
        f"{status.time_s:.0f}/{status.steps * step_s:.0f} s",
        _speed(speed, "").strip(),
        f"{_rate(messages_per_s)} messages/s",
        f"{status.agents_in_trees} in trees",
        f"waiting {status.mean_waiting_s:.1f} s",
    )
    text = ""
    for part in filter(None, parts):
        longer = f"{text}, {part}" if text else part
        if text and len(longer) > room:
            break
        text = longer
    return text


def _speed(speed: float | None, after: str) -> str:
    return "" if speed is None else f"{speed:.0f}x{after}"


def _rate(messages_per_s: float | None) -> str:
    return "-" if messages_per_s is None else f"{messages_per_s:.1f}"


ROWS = (
    ("mean waiting time", "waiting_time_s.mean", "s"),
    ("median waiting time", "waiting_time_s.median", "s"),
    ("events sensed", "waiting_time_s.n", ""),
    ("events never sensed", "waiting_time_s.never_sensed", ""),
    ("operator messages", "operator_messages_per_s.mean", "per s"),
    ("reports sent", "reports.sent", ""),
    ("reports arrived", "reports.arrived", ""),
    ("radio frames sent", "frames_sent_per_s.mean", "per s"),
    ("radio bytes sent", "bytes_sent_per_s.mean", "per s"),
    ("agents in trees", "agents_in_trees.mean", ""),
    ("trees", "trees.mean", ""),
    ("area covered while trees exist", "covered_area_m2.mean_while_trees", "m²"),
    ("lost on the fabric", "transport_lost", "messages"),
    ("steps", "steps", ""),
    ("speed", "steps_per_s", "steps/s"),
    ("digest", "digest", ""),
    ("valid", "valid", ""),
)


def result_table(summary: dict[str, Any]) -> Table:
    """The summary's main figures as a table."""
    table = Table(title=f"{summary['name']}, {summary['mode']}, seed {summary['seed']}", show_header=False)
    table.add_column(style="dim")
    table.add_column(justify="right")
    table.add_column(style="dim")
    for label, path, unit in ROWS:
        value: Any = summary
        for key in path.split("."):
            value = value[key]
        table.add_row(label, _shown(value), unit)
        if path == "reports.arrived":
            for reason, count in summary["reports_dropped"].items():
                if count:
                    table.add_row(f"reports dropped: {reason}", _shown(count), "")
    return table


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "NO"
    return f"{value:.2f}" if isinstance(value, float) else str(value)
