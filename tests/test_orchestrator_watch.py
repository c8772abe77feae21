"""The watch over a swarm: whose end is told, and in which order."""

import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from deltaswarm_orchestrator.run.part import Part
from deltaswarm_orchestrator.run.watch import Watch
from deltaswarm_wire.exits import WORLD_LOST
from deltaswarm_wire.keys import OPERATOR, WORLD

UNTIL_KILLED = "import signal; signal.pause()"


class Told:
    """A real process of which the fork server tells only when it has been asked some times after its end."""

    def __init__(self, program: str, told_after: int) -> None:
        self._process = subprocess.Popen([sys.executable, "-c", program])
        self._askings_left = told_after
        self.pid = self._process.pid

    @property
    def exitcode(self) -> int | None:
        """As the fork server tells it."""
        code = self._process.poll()
        if code is None or self._askings_left:
            self._askings_left -= code is not None
            return None
        return code

    def end(self) -> int:
        """Kill it, unless it has ended by itself."""
        self._process.kill()
        return self._process.wait()


@pytest.fixture
def ending() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.mark.parametrize("told_after", range(6))
def test_the_end_of_the_world_is_told_before_that_of_an_operator_who_lost_it(
    told_after: int, ending: ExitStack, tmp_path: Path
) -> None:
    """Even if the orchestrator hears of the operator's end first; and nobody starts an operator without a world."""
    world = Told(UNTIL_KILLED, told_after)
    operator = Told(f"raise SystemExit({WORLD_LOST})", told_after=0)
    for process in (world, operator):
        ending.callback(process.end)
    parts = [Part(role, 0, cast(Any, each), tmp_path / role) for role, each in ((WORLD, world), (OPERATOR, operator))]
    for part in parts:
        ending.callback(part.close)
    assert operator._process.wait() == WORLD_LOST
    assert world.end() == -signal.SIGKILL
    started: list[bool] = []
    swarm = SimpleNamespace(
        has_station=False,
        part=lambda role: next(part for part in parts if part.role == role),
        ended=lambda: [part for part in parts if part.exit_code is not None],
        start_operator=lambda publish_all, go_on: started.append(go_on),
        write_pids=lambda: None,
        stop_world=lambda: None,
    )
    observer = SimpleNamespace(
        work=lambda within_s: False,
        status=SimpleNamespace(phase="stepping", step=7),
        newest_step=7,
        newest_workload=None,
        orders=deque(),
        heard_at=time.monotonic(),
        records=True,
        leave_when_done=lambda: None,
    )
    reporter = SimpleNamespace(update=lambda status, rate_60s_hz: None)
    watch = Watch(cast(Any, swarm), cast(Any, observer), cast(Any, reporter), cast(Any, SimpleNamespace(by=None)), 60.0)
    watch.to_the_end()
    assert [line.split()[0] for line in watch.why] == [WORLD, OPERATOR]
    assert "SIGKILL" in watch.why[0]
    assert not started
