"""How speed scales, in one process and with real ones: one density at any size, each measurement in its process."""

import itertools
import json
import math
from pathlib import Path
from typing import Any

import pytest

from benchmarks import coverage, processes, scale
from benchmarks.__main__ import main as benchmarks
from benchmarks.__main__ import parser
from deltaswarm_orchestrator.base.exits import named
from deltaswarm_orchestrator.bench import speed
from deltaswarm_orchestrator.cli import main
from deltaswarm_orchestrator.processes.starter import LEASE, OTHER_SESSIONS, STARTED, room_for
from deltaswarm_studies import style
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test


@in_one_test(("agents", "tiles"), [(1, 1), (25, 1), (30, 1), (50, 2), (100, 4), (200, 8), (400, 16)])
def test_every_size_has_the_papers_density(agents: int, tiles: int) -> None:
    """Of agents and of events; each tile has its own gaussian, and all tiles are alike."""
    made = scale.scale_scenario(agents, 100)
    area_m2 = made.arena.width_m * made.arena.height_m
    assert made.agents.count == agents
    assert agents / area_m2 == pytest.approx(speed.AGENTS_PER_M2)
    assert made.events.rate_hz / agents == pytest.approx(0.05 / 25)
    assert made.run.steps == 100
    assert made.problems() == []
    means = [component.mean_m for component in made.events.density.components]
    assert len(set(means)) == tiles
    side_m = (area_m2 / tiles) ** 0.5
    for (x_m, y_m), (other_x_m, other_y_m) in itertools.combinations(means, 2):
        assert max(abs(x_m - other_x_m), abs(y_m - other_y_m)) > 0.999 * side_m


@pytest.mark.processes
def test_growth_is_measured_between_sizes() -> None:
    """Speed, trees and memory of each size, and the exponent of the time of a step."""
    found = scale.measure((5, 20), 30, 1)
    assert [row["agents"] for row in found["sizes"]] == [5, 20]
    for row in found["sizes"]:
        assert row["agent_steps_per_s"] == pytest.approx(row["agents"] * row["steps_per_s"])
        assert 0 <= row["share_in_trees"] <= 1
        assert row["world_us_per_agent"] + row["agents_us_per_agent"] == pytest.approx(row["us_per_agent"])
        assert row["us_per_asked_agent"] * row["share_asked"] == pytest.approx(row["us_per_agent"])
        assert 10 < row["peak_memory_mb"] < 1000
    small, large = (row["steps_per_s"] for row in found["sizes"])
    assert found["step_time_exponent"] == pytest.approx(math.log(small / large) / math.log(20 / 5))


def test_a_cost_per_asked_agent_needs_one_that_was_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two agents that meet no event are never asked: null in JSON, a dash in the table."""
    monkeypatch.setattr(scale, "WARM_UP_STEPS", 0)
    row = scale._measure_size(2, 5, seed=1)
    assert row["share_asked"] == 0
    assert [name for name, value in row.items() if value is None] == [
        f"{part}us_per_asked_agent" for part in ("", "world_", "agents_")
    ]
    assert "-" in named({"sizes": [row]}).splitlines()[-1].split()


def test_a_median_is_of_the_rounds_in_which_it_was_measured() -> None:
    """None only if there is no such round."""
    rows = [{"a": 1.0, "b": None, "c": None}, {"a": 2.0, "b": 5.0, "c": None}]
    assert scale.median_of(rows) == {"a": 1.5, "b": 5.0, "c": None}


def test_the_memory_of_a_process_that_has_ended_is_not_zero() -> None:
    """It is unknown."""
    assert speed._pss_mb(2**22 + 1) is None  # beyond the largest process id


@pytest.mark.parametrize("power", [0.0, 1.0, 1.3])
def test_the_exponent_is_the_power_of_the_size(power: float) -> None:
    """Whatever the cost of one agent."""
    sizes = (25, 100, 1000)
    assert scale.exponent(sizes, [3e-5 * size**power for size in sizes]) == pytest.approx(power)


def test_one_outlier_does_not_decide_the_exponent() -> None:
    """All sizes count alike."""
    assert scale.exponent((10, 100, 1000), [10, 200, 1000]) == pytest.approx(1.0)


@pytest.mark.parametrize("sizes", [(25, 25), ()])
def test_growth_needs_two_sizes(sizes: tuple[int, ...]) -> None:
    """Before anything is started."""
    with pytest.raises(ValueError, match="two different sizes"):
        scale.measure(sizes, 30, 1)


def measure(words: str) -> int:
    """`deltaswarm bench run`, or one of the developers' measurements."""
    return main(["bench", *words.split()]) if words.startswith("run ") else benchmarks(words.split())


@pytest.mark.parametrize(
    "option",
    ["run --agents=0", "run --steps=-1", "radio --rounds=x", "scale --sizes=25,0", "run --steps=1.5", "run --agents="],
)
def test_what_cannot_be_measured_is_refused(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With exit code 2, the option and what was given."""
    with pytest.raises(SystemExit) as ended:
        measure(option)
    name, _, value = option.split()[1].partition("=")
    error = capsys.readouterr().err
    assert ended.value.code == 2
    assert f"{name}: must be an integer from 1 to 1000000000 (got " in error
    assert repr(value.rpartition(",")[2]) in error


@pytest.mark.parametrize("command", ["coverage --agents=3", "run --rounds=2", "radio --plot=x", "processes --agents=3"])
def test_a_measurement_takes_only_options_that_it_uses(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Others are refused by name before anything is measured."""
    with pytest.raises(SystemExit) as ended:
        measure(command)
    assert ended.value.code == 2
    assert command.split()[1].partition("=")[0] in capsys.readouterr().err


@pytest.mark.parametrize("name", ["missing/x", "file/x", "", "/", "folder/taken", "x" * 300, "nul\0"])
def test_a_figure_that_cannot_be_written_is_refused_before_the_measurement(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """In one line; nothing is written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    (tmp_path / "folder" / "taken.svg").mkdir(parents=True)
    monkeypatch.setattr(scale, "measure", lambda *_: pytest.fail("measured"))
    before = sorted(tmp_path.rglob("*"))
    assert benchmarks(["scale", f"--plot={name}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("deltaswarm: --plot must be ")
    assert sorted(tmp_path.rglob("*")) == before


def test_results_are_printed_even_if_their_figure_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """As on a disk that has become full meanwhile: one line about it, and the whole result."""

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device", "x.png")

    result = {"rounds": 1, "step_s": 1.0, "rows": [{"range_m": None, "loss": 0.0, "share_known": [0.0, 1.0]}]}
    monkeypatch.setattr(coverage, "measure", lambda *_: result)
    monkeypatch.setattr(style, "save", full)
    assert benchmarks(["coverage", f"--plot={tmp_path / 'x'}", "--json"]) == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out) == result
    assert printed.err == "deltaswarm: x.png could not be written: No space left on device\n"


def test_a_thousand_agents_and_more_may_join_at_once() -> None:
    """Beyond Zenoh's own limits on sessions and handshakes."""
    settings = dict(room_for(1500))
    for name in ("max_sessions", "accept_pending"):
        assert settings[f"transport/unicast/{name}"] == str(1500 + OTHER_SESSIONS)
    assert int(settings[LEASE]) == 90_000  # a link may be silent while the others start
    assert LEASE not in dict(room_for(100))


def test_defaults_are_the_measurements_own() -> None:
    """Other measurements keep theirs."""
    many = parser().parse_args(["processes"])
    assert (many.sizes, many.steps) == ([25, 100, 400, 1000], 100)
    in_one = parser().parse_args(["scale"])
    assert (in_one.sizes[-1], in_one.steps) == (1000, 1000)


@pytest.mark.processes
def test_each_size_has_a_row() -> None:
    """Smallest first, whatever the order; no process is left on Python's list."""
    rows = processes.measure((6, 3), 20)["sizes"]
    assert [row["agents"] for row in rows] == [3, 6]
    for row in rows:
        assert row["agent_steps_per_s"] == pytest.approx(row["agents"] * row["steps_per_s"])
        assert 1 < row["median_agent_pss_mb"] <= row["largest_agent_pss_mb"] < 50
        assert row["open_files"] > 3 * row["agents"]
        assert 0 <= row["stolen_share"] <= 1
    assert not STARTED
