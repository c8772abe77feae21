"""The unicycle without hardware: what it promises whatever it is told."""

import math
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.body import BodyContext
from deltaswarm_board.bodies.events_file import MAX_ROWS, event_field, read_events
from deltaswarm_board.bodies.kinematic import KinematicBody, KinematicSettings
from deltaswarm_wire.checked import check, load
from deltaswarm_wire.messages import Event
from deltaswarm_wire.settings import AgentSettings
from tests.support.tiers import in_one_test

QUIET = {"speed_noise": 0.0, "turn_noise_rad": 0.0, "drift": 0.0, "fix_std_m": 0.0}

velocities = st.tuples(st.floats(-3, 3), st.floats(-3, 3))
drives = st.lists(st.tuples(velocities, st.floats(0.05, 2)), max_size=15)


def a_body(seed: int = 1, **options: Any) -> KinematicBody:
    context = BodyContext(1, load(AgentSettings, {"speed_mps": 1.0}), Random(seed))
    return KinematicBody(load(KinematicSettings, options), context)


@given(drives, st.integers(0, 3))
def test_the_same_seed_and_commands_give_the_same_drive(drive: Any, seed: int) -> None:
    one, other = a_body(seed), a_body(seed)
    now_s = 0.0
    for velocity, for_s in drive:
        one.move(*velocity, ())
        other.move(*velocity, ())
        now_s += for_s
        assert one.sense(now_s) == other.sense(now_s)


@given(drives, st.integers(0, 3))
def test_it_is_never_faster_than_its_agents_speed(drive: Any, seed: int) -> None:
    body = a_body(seed, speed_noise=0.5)
    now_s = 0.0
    for velocity, for_s in drive:
        before = body.true_m
        body.move(*velocity, ())
        now_s += for_s
        body.sense(now_s)
        assert math.dist(before, body.true_m) <= 1.0 * for_s + 1e-9


@given(st.floats(-math.pi, math.pi), st.floats(0.1, 1), st.floats(0.5, 5))
def test_without_errors_it_comes_to_where_it_is_sent(direction_rad: float, speed_mps: float, far_m: float) -> None:
    """By an agent that commands anew each second: turning costs it way at first, and it stops on the place."""
    body = a_body(**QUIET)
    to = (far_m * math.cos(direction_rad), far_m * math.sin(direction_rad))
    for now_s in range(200):
        at = body.sense(float(now_s))
        left_m = math.dist(to, at[:2])
        share = min(1.0, speed_mps / left_m) if left_m else 0.0
        body.move((to[0] - at.x_m) * share, (to[1] - at.y_m) * share, ())
    assert math.dist(body.true_m, to) < 0.01


def test_it_turns_no_faster_than_it_can() -> None:
    """Half a turn at 0.5 rad/s takes longer than 6 s, and until it is half round it does not move."""
    body = a_body(turn_rate_radps=0.5, **QUIET)
    for now_s in range(1, 4):
        body.move(-1.0, 0.0, ())
        body.sense(float(now_s))
    assert body.true_m == (0.0, 0.0)
    assert body.heading_rad == pytest.approx(1.5)


def test_a_command_ends_by_itself() -> None:
    """Two steps after the last one it stands, as a vehicle without set-points does."""
    body = a_body(**QUIET)
    body.move(1.0, 0.0, ())
    assert body.sense(60.0).x_m == pytest.approx(2.0)


def test_odometry_drifts_with_the_way_and_is_set_right() -> None:
    """The believed place is not the true one; its uncertainty says by how much, and a fix ends it."""
    errors, stds = [], []
    for seed in range(200):
        body = a_body(seed, drift=0.1, fix_interval_s=0.0, fix_std_m=0.01)
        for now_s in range(1, 30):
            body.move(1.0, 0.0, ())
            sensed = body.sense(float(now_s))
        errors.append(sensed.x_m - body.true_m[0])
        stds.append(sensed.std_m)
    spread_m = math.sqrt(sum(error**2 for error in errors) / len(errors))
    assert spread_m == pytest.approx(sum(stds) / len(stds), rel=0.15)
    assert spread_m > 0.4

    body = a_body(drift=0.1, fix_interval_s=10.0, fix_std_m=0.01)
    for now_s in range(1, 11):
        body.move(1.0, 0.0, ())
        sensed = body.sense(float(now_s))
    assert sensed.std_m == pytest.approx(0.01)
    assert math.dist(sensed[:2], body.true_m) < 0.05


def an_events_file(folder: Path, *rows: str) -> str:
    file = folder / "events.csv"
    file.write_text("\n".join(["event,x_m,y_m,from_s,until_s,work_s", *rows]) + "\n")
    return str(file)


def test_events_come_and_go_by_the_file(tmp_path: Path) -> None:
    """From and until its times, within the sensing range of the true place."""
    body = a_body(events=an_events_file(tmp_path, "1,3,0,10,20,", "2,30,0,,,", "3,0,1,,,"), **QUIET)
    assert body.sense(9.0).events == (Event(3, 0.0, 1.0),)
    assert body.sense(10.0).events == (Event(1, 3.0, 0.0), Event(3, 0.0, 1.0))
    assert body.sense(20.0).events == (Event(3, 0.0, 1.0),)


def test_an_event_is_complete_after_its_own_observers_work(tmp_path: Path) -> None:
    body = a_body(events=an_events_file(tmp_path, "1,3,0,,,5", "2,30,0,,,1"), **QUIET)
    for now_s in range(1, 5):
        body.move(0.0, 0.0, (1, 2))
        assert body.sense(float(now_s)).events
    body.move(0.0, 0.0, ())
    assert body.sense(5.0).events
    body.move(0.0, 0.0, (1, 2))
    assert not body.sense(6.0).events


def test_an_event_is_seen_from_the_believed_place(tmp_path: Path) -> None:
    """So it carries the body's own error: what is 3 m ahead is 3 m ahead of where it believes to be."""
    body = a_body(events=an_events_file(tmp_path, "1,3,0,,,"), fix_std_m=0.5)
    sensed = body.sense(1.0)
    assert sensed.x_m != 0.0
    assert sensed.events[0].x_m - sensed.x_m == pytest.approx(3.0)


@in_one_test(
    ("text", "word"),
    [
        ("", "an empty file"),
        ("event,x_m,y_m\n", "no row"),
        ("event,x_m\n1,2\n", "got event, x_m"),
        ("event,x_m,y_m,size\n1,2,3,4\n", "size"),
        ("event,x_m,y_m,x_m\n1,2,3,4\n", "got x_m twice"),
        ("event,x_m,y_m\n1,2,\n", "y_m must"),
        ("event,x_m,y_m\n1,2\n", "3 cells"),
        ("event,x_m,y_m\n1,2,3,4\n", "3 cells"),
        ("event,x_m,y_m\n1,nan,3\n", "'nan'"),
        ("event,x_m,y_m\n1.5,2,3\n", "'1.5'"),
        ("event,x_m,y_m\n-1,2,3\n", "'-1'"),
        ("event,x_m,y_m\n1,2,3\n1,2,3\n", "line 3: event"),
        ("event,x_m,y_m\n1,2," + "3" * 200_000, "field limit"),
        ("event,x_m,y_m,from_s,until_s\n1,2,3,5,5\n", "above from_s"),
        ("event,x_m,y_m,work_s\n1,2,3,soon\n", "'soon'"),
        ("event,x_m,y_m\n" + "".join(f"{n},0,0\n" for n in range(MAX_ROWS + 1)), f"at most {MAX_ROWS}"),
    ],
)
def test_a_bad_events_file_is_refused_with_its_line(text: str, word: str) -> None:
    with pytest.raises(ValueError, match=r"^line \d+") as caught:
        read_events(text)
    assert word in str(caught.value)


def test_options_name_a_file_that_is_not_there(tmp_path: Path) -> None:
    made, problems = check(KinematicSettings, {"events": str(tmp_path / "none.csv"), "drift": -1})
    assert made is None
    assert [problem.path for problem in problems] == ["drift"]
    _, problems = check(KinematicSettings, {"events": str(tmp_path / "none.csv")}, "body.options")
    assert [problem.path for problem in problems] == ["body.options.events"]
    assert event_field("", 5.0).sensed(0.0, 0.0, 0.0, (0.0, 0.0)) == ()
