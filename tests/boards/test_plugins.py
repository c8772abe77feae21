"""A body that somebody else wrote: found where pip puts it, and nothing that it does takes the agent down at once."""

import math
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast
from zipfile import ZipFile

import pytest

from deltaswarm_agent.body import Body, Sensed
from deltaswarm_board.bodies import make_body
from deltaswarm_board.driver import MAX_FAILURES, Driver
from deltaswarm_wire.messages import MAX_SENSED, Event
from tests.support.cores import Core, agent_settings
from tests.support.fields import EVENT_AT, board_table, boards, endpoint, free_port
from tests.support.swarms import wait_until

ROVER = """
import sys
from dataclasses import dataclass
from deltaswarm_agent.body import Sensed
from deltaswarm_wire.checked import key

@dataclass(frozen=True)
class Options:
    x_m: float = key(0.0, "where it is", low=0)

class Rover:
    Settings, REAL_TIME = Options, True
    def __init__(self, options, context):
        self.x_m = options.x_m
    def sense(self, time_s):
        return Sensed(self.x_m, 1.0, 0.1)
    def move(self, vx_mps, vy_mps, observed):
        pass
    def close(self):
        print("the rover stands", file=sys.stderr)
"""


def wheel(folder: Path) -> Path:
    """A package that knows nothing of ours but the entry points' group."""
    file = folder / "rover-1.0-py3-none-any.whl"
    with ZipFile(file, "w") as archive:
        for name, text in {
            "rover_body.py": ROVER,
            "rover-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: rover\nVersion: 1.0\n",
            "rover-1.0.dist-info/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
            "rover-1.0.dist-info/entry_points.txt": "[deltaswarm.bodies]\nrover = rover_body:Rover\n",
            "rover-1.0.dist-info/RECORD": "",
        }.items():
            archive.writestr(name, text)
    return file


@pytest.mark.processes
def test_a_body_of_another_package_drives_an_agent(tmp_path: Path) -> None:
    """Installed by pip, named by its entry point or by module and class, with its own options."""
    place = str(tmp_path / "installed")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--target", place, str(wheel(tmp_path))], check=True)
    with boards(tmp_path) as running:
        for agent, kind in enumerate(("rover", "rover_body:Rover")):
            table = board_table(agent, EVENT_AT, {"listen": [endpoint(free_port())]}, tmp_path)
            table["body"] = {"kind": kind, "options": {"x_m": 7.5}}
            running.start(table, environment={"PYTHONPATH": place})
        for agent in range(2):
            wait_until(lambda agent=agent: "first step" in running.said(agent), "a first step")
            assert running.stop(agent) == 0
            assert "at (7.50, 1.00) m" in running.said(agent)
            assert "the rover stands" in running.said(agent)


class Erratic:
    """A body that gives what it is told to, and raises what it is told to."""

    def __init__(self, gives: Iterator[Any]) -> None:
        self.gives = gives
        self.moves = 0
        self.move_fails = False

    def sense(self, time_s: float) -> Any:
        found = next(self.gives)
        if isinstance(found, Exception):
            raise found
        return found

    def move(self, vx_mps: float, vy_mps: float, observed: tuple[int, ...]) -> None:
        self.moves += 1
        if self.move_fails:
            raise OSError("the wheel is off")

    def close(self) -> None:
        """Nothing."""


WELL = Sensed(5.0, 5.0, 0.1, (Event(1, 6.0, 5.0),))


def steps(*gives: Any) -> tuple[Driver, Erratic, list[str]]:
    body = Erratic(iter(gives))
    driver = Driver(Core(1, agent_settings()).core, as_body(body), step_s=1.0, arrive_m=0.2, max_std_m=1.0)
    faults = []
    for step in range(len(gives)):
        decision = driver.step(step, float(step), lambda at: ())
        assert (decision is None) == bool(driver.fault)
        faults.append(driver.fault)
    return driver, body, faults


def as_body(body: Any) -> Body:
    made: Body = body
    return made


def test_a_body_that_raises_now_and_then_is_not_well_then() -> None:
    """Each seventh call; the agent goes on, and tells it to stand meanwhile."""
    driver, body, faults = steps(*(RuntimeError("seventh") if step % 7 == 6 else WELL for step in range(70)))
    assert [bool(fault) for fault in faults] == [step % 7 == 6 for step in range(70)]
    assert "RuntimeError: seventh" in faults[6]
    assert (driver.faulty_steps, body.moves) == (10, 70)


def test_a_body_that_always_raises_ends_the_agent() -> None:
    """So that it is started anew; a step in which it is well, or says itself what is wrong, begins the count again."""
    failing = [OSError("gone")] * (MAX_FAILURES - 1)
    steps(*failing, WELL, *failing, Sensed(0.0, 0.0, 0.0, fault="battery"), *failing)
    with pytest.raises(OSError, match="gone"):
        steps(*failing, OSError("gone"))


def test_a_body_that_cannot_be_moved_is_not_well() -> None:
    driver, body, _ = steps(*[WELL] * 2)
    body.move_fails = True
    body.gives = iter([WELL] * MAX_FAILURES)
    for step in range(2, MAX_FAILURES + 1):
        assert driver.step(step, float(step), lambda at: ()) is not None
        assert "OSError: the wheel" in driver.fault
    with pytest.raises(OSError, match="wheel"):
        driver.step(99, 99.0, lambda at: ())


@pytest.mark.parametrize(
    ("gives", "word"),
    [
        (None, "got NoneType"),
        ((5.0, 5.0, 0.1), "got tuple"),
        (Sensed("left", 5.0, 0.1), "could not convert"),  # type: ignore[arg-type]
        (Sensed(5.0, 5.0, -1.0), "deviation of -1 m"),
        (Sensed(5.0, 5.0, 0.1, (Event(1, math.nan, 3.0),)), r"event=1, x_m=nan"),
        (Sensed(5.0, 5.0, 0.1, (Event(1, 1e300, 3.0),)), "event=1, x_m=1e"),
        (Sensed(5.0, 5.0, 0.1, (Event(-1, 2.0, 3.0),)), "event=-1"),
        (Sensed(5.0, 5.0, 0.1, (WELL.events * (MAX_SENSED + 1))), "1000 .*1001"),
    ],
)
def test_what_no_body_may_give_is_a_fault(gives: Any, word: str) -> None:
    _, _, faults = steps(gives, WELL)
    assert faults[1] == ""
    assert re.search(word, faults[0]), faults


class Odd(Erratic):
    """A body as a board makes it."""

    def __init__(self, options: Any, context: Any) -> None:
        super().__init__(options)


def test_its_class_and_file_are_named() -> None:
    body = make_body(cast(Any, Odd), iter([None, OSError("gone")]), cast(Any, None))
    driver = Driver(Core(1, agent_settings()).core, body, step_s=1.0, arrive_m=0.2, max_std_m=1.0)
    for step, said in enumerate(("TypeError: sense must return a Sensed", "OSError: gone")):
        driver.step(step, float(step), lambda at: ())
        assert f"{__name__}:Odd.sense failed: {said}" in driver.fault
        assert f"{__file__}:" in driver.fault


def test_any_numbers_do() -> None:
    numpy = pytest.importorskip("numpy")
    place = numpy.float32(5.5)
    driver, _, faults = steps(Sensed(place, place, place / 100, (Event(numpy.int64(3), place, place),)))
    assert faults == [""]
    assert [type(value) for value in driver.place_m] == [float, float]
