"""Hardware in the loop on two machines: 20 agents beside the world, five on boards behind a link with delay."""

import os
from pathlib import Path
from typing import Any

import pytest

from tests.support.loops import Loop, loop
from tests.support.namespaces import NEEDS_NAMESPACES, network
from tests.support.swarms import PATIENCE_S

pytestmark = NEEDS_NAMESPACES

IS_LONG = "DELTASWARM_LONG" in os.environ
WALL_S = 120 if IS_LONG else 8
"""How long a run takes at least."""

DELAY_S = 0.02
"""Each way; a step of 1 s at factor 4 is over after 0.25 s, and boards have six times what the link takes."""

TOO_LONG_S = 0.4
"""Each way; at factor 10 the way there and back takes eight steps."""

WORLD, BOARD = 0, 1
BOARDS = range(20, 25)


def run_apart(folder: Path, listen: str, factor: int, delay_s: float = DELAY_S) -> tuple[dict[str, Any], Loop]:
    pace = [f"run.real_time_factor={factor}", "run.clock=realtime", f"run.duration_s={WALL_S * factor}"]
    settings = [argument for setting in pace for argument in ("--set", setting)]
    with network(2, delay_s) as net:
        endpoint = listen.format(net.address(WORLD))
        places = {"inside": net.inside(WORLD), "boards_inside": net.inside(BOARD)}
        arguments = ("--listen", endpoint, "--record", "off", *settings)
        with loop(folder, BOARDS, *arguments, scenario="paper-25", **places) as made:
            for board in BOARDS:
                made.start(board)
            return made.finish(WALL_S + PATIENCE_S), made


@pytest.mark.parametrize(("factor", "listen"), [(1, "tcp/{}:7447"), (4, "tls/{}:7447")])
def test_boards_on_another_machine_take_part(factor: int, listen: str, tmp_path: Path) -> None:
    """In real time: all steps, nothing lost, and the boards close most of them in time.

    A board that is always too slow by a little is late in every other step. How well a machine holds the pace, `bench`
    says: here a busy one only takes longer.
    """
    summary, made = run_apart(tmp_path, listen, factor)
    steps = WALL_S * factor
    assert (summary["valid"], summary["steps"], summary["transport_lost"]) == (True, steps, 0)
    assert summary["wall_s"] >= WALL_S
    assert set(summary["boards"]) == {str(board) for board in BOARDS}
    for board, attendance in summary["boards"].items():
        assert attendance["absences"] == 0
        assert attendance["late_steps"] < steps / 2, f"board {board}: {attendance}"
        assert f"exits after step {steps - 1}" in made.said(int(board))


def test_boards_that_cannot_be_in_time_stall_nobody(tmp_path: Path) -> None:
    """With a link that is slower than a step they miss most steps, and the run takes no longer than without delay.

    A world that waited for them would take eight times as long.
    """
    swift, _ = run_apart(tmp_path / "swift", "tcp/{}:7447", 10, delay_s=0.0)
    slow, _ = run_apart(tmp_path / "slow", "tcp/{}:7447", 10, delay_s=TOO_LONG_S)
    assert swift["valid"]
    assert slow["valid"]
    assert slow["steps"] == swift["steps"] == WALL_S * 10
    assert all(attendance["late_steps"] > slow["steps"] / 3 for attendance in slow["boards"].values())
    assert slow["wall_s"] < 3 * swift["wall_s"]
