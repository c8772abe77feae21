"""What a noisy machine allows to be said: stolen time, spread, and ratios only on a steady floor."""

from pathlib import Path

import pytest

from deltaswarm_orchestrator.bench import rounds as noise


def test_stolen_time_is_a_share_of_all_time(tmp_path: Path) -> None:
    """Guest time, the last two counters, is part of user time already."""
    (file := tmp_path / "stat").write_text("cpu  10 1 5 70 2 0 2 10 7 3\ncpu0 1 1 1 1 1 1 1 1 1 1\n")
    before = noise.cpu_ticks(file)
    assert before == (10, 100)
    assert noise.stolen_share(before, (40, 200)) == pytest.approx(0.3)
    assert noise.stolen_share(before, before) == 0


def test_this_machine_has_such_counters() -> None:
    """The stolen time is at most the whole time."""
    stolen, whole = noise.cpu_ticks()
    assert 0 <= stolen < whole


def test_spread_is_relative_to_the_median() -> None:
    """One value does not spread."""
    assert noise.spread([110.0, 90.0, 100.0]) == pytest.approx(0.2)
    assert noise.spread([5.0]) == 0


def test_shares_are_those_of_the_same_round() -> None:
    """A load on the machine slows both in its round."""
    shares, why = noise.shares([50, 30, 45], {"zenoh": [100, 90, 90]})
    assert shares == {"zenoh": pytest.approx(0.5)}
    assert why is None


def test_an_unsteady_floor_gives_no_ratio() -> None:
    """The text names it with its spread; the steady one keeps its ratio."""
    shares, why = noise.shares([50, 50, 50], {"zenoh": [100, 100, 121], "own_traffic": [100, 100, 119]})
    assert shares == {"zenoh": None, "own_traffic": pytest.approx(0.5)}
    assert why is not None
    assert "20%" in why
    assert "zenoh 21%" in why
    assert "own_traffic" not in why
