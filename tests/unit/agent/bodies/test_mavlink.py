"""A MAVLink vehicle as a body, against a scripted vehicle in a process of its own: real MAVLink over UDP."""

import math
import os
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from deltaswarm_agent.body import BodyContext
from deltaswarm_agent.controllers.paper.frames import Descendant, Leaving, Member, RecruitmentOrder, encode
from deltaswarm_board.bodies.mavlink import MavlinkBody, has_restarted
from deltaswarm_board.bodies.mavlink_settings import MavlinkSettings
from deltaswarm_wire.checked import load
from deltaswarm_wire.envelope import Sample, encode_sample
from deltaswarm_wire.messages import Event
from deltaswarm_wire.settings import AgentSettings
from tests.support.fields import RUN, board_table, boards, endpoint, free_port, listening
from tests.support.flights import STEP_S, TASK, Flight, a_body, flying, go
from tests.support.swarms import PATIENCE_S, wait_until
from tests.support.tiers import in_one_test

pytestmark = pytest.mark.processes


@in_one_test(
    ("before_ms", "boot_ms", "passed_s", "is_restart"),
    [
        (30_000, 31_000, 1.0, False),
        (30_000, 29_500, 0.1, False),  # datagrams in another order
        (30_000, 2_000, 1.0, True),
        (30_000, 45_000, 60.0, True),  # the link was lost for longer than it had run before
        (30_000, 90_000, 60.0, False),
        (30_000, 31_000, 4.0, False),  # a simulated one may be slow
        (2**32 - 1000, 500, 1.5, False),  # its clock begins anew after 50 days
    ],
)
def test_an_autopilot_that_started_again_is_known_by_its_clock(
    before_ms: int, boot_ms: int, passed_s: float, is_restart: bool
) -> None:
    assert has_restarted(before_ms, boot_ms, passed_s) == is_restart


def test_x_is_east_and_y_is_north_and_no_faster_than_allowed() -> None:
    """Velocities arrive in the vehicle's frame, cut to the limit; positions come back in the arena's."""
    with a_body(origin_north_m=-2.0, origin_east_m=-5.0) as (body, flight):
        assert body.sense(0.0)[:2] == pytest.approx((5.0, 2.0))
        go(body, 30.0, 0.0, lambda: flight.at[0] > 1.0, "a metre to the east")
        assert flight.speed_mps == pytest.approx(2.0)
        go(body, 0.0, 1.0, lambda: flight.at[1] > 0.5, "half a metre to the north")
        assert flight.at[0] == pytest.approx(body.sense(0.0).x_m - 5.0, abs=0.5)


def test_a_turned_arena_turns_both_ways() -> None:
    with a_body(heading_deg=90.0, origin_north_m=8.0, origin_east_m=-8.0) as (body, flight):
        go(body, 1.0, 0.0, lambda: flight.at[1] < -0.5, "half a metre to the south")
        wait_until(lambda: body.sense(0.0).x_m > 8.4, "the same along x")
        assert body.sense(0.0).y_m == pytest.approx(8.0, abs=0.1)


def test_a_vehicle_stands_when_its_agent_stalls() -> None:
    """The agent's thread says nothing more, and the body's own has the vehicle stand; when, the guard's tests say."""
    with a_body() as (body, flight):
        go(body, 1.0, 0.0, lambda: flight.speed_mps > 0.9, "speed")
        stalled_s = time.monotonic()
        wait_until(lambda: flight.speed_mps == 0.0, "a stand")
        stood = next(row for row in flight.track if row[0] > stalled_s and row[3:5] == [0.0, 0.0])
        assert stood[5] > 0, "set-points go on, of zero"
        go(body, 1.0, 0.0, lambda: flight.speed_mps > 0.9, "speed again, once the agent is back")


def test_a_rover_that_stands_keeps_its_heading() -> None:
    """A velocity of zero has no direction, and a rover would take it for north."""
    with a_body("rover") as (body, flight):
        go(body, 1.0, 0.0, lambda: flight.speed_mps > 0.9, "speed")
        assert flight.track[-1][6] == pytest.approx(math.pi / 2), "east"
        sent = flight.track[-1][5]
        go(body, 0.0, 0.0, lambda: flight.speed_mps == 0.0 and flight.track[-1][5] > sent + 10, "a stand")
        assert flight.track[-1][6] == pytest.approx(math.pi / 2)


def test_a_copter_takes_off_undisturbed_and_only_then_obeys_the_agent() -> None:
    """ArduPilot ends a take-off at the first set-point, so there is none until the copter is in the air."""
    with a_body() as (body, flight):
        flight.tell("land")
        wait_until(lambda: "not in the air" in body.sense(0.0).fault, "a fault")
        flight.hears_what_was_sent()
        flight.tell("takeoff")
        go(body, 1.0, 0.0, lambda: not body.sense(0.0).fault, "the end of the take-off")
        go(body, 1.0, 0.0, lambda: flight.speed_mps > 0.9, "speed")


def test_a_px4_gets_set_points_on_the_ground_too_so_that_it_can_change_to_offboard() -> None:
    """It refuses the mode without them; they are of zero until it is in the air."""
    with a_body("px4") as (body, flight):
        for word in ("land", "loiter"):
            flight.tell(word)
        wait_until(lambda: "mode LOITER" in body.sense(0.0).fault, "the pilot's mode")
        sent = flight.track[-1][5]
        go(body, 1.0, 0.0, lambda: flight.track[-1][5] > sent + 10, "set-points")
        flight.tell("guided")
        wait_until(lambda: "not in the air" in body.sense(0.0).fault, "OFFBOARD")
        flight.tell("takeoff")
        go(body, 1.0, 0.0, lambda: flight.speed_mps > 0.9, "speed")


def test_what_a_rebooted_autopilot_forgot_is_asked_for_and_its_place_is_not_trusted() -> None:
    """Its local frame begins where it booted: fence and arena may lie elsewhere now. A new agent begins anew."""
    with a_body() as (body, flight):
        flight.tell("reboot")
        wait_until(lambda: "no position" in body.sense(0.0).fault, "the end of its positions")
        wait_until(lambda: "restarted" in body.sense(0.0).fault, "positions, with a clock that went back")
        sent = flight.track[-1][5]
        go(body, 1.0, 0.0, lambda: flight.track[-1][5] > sent + 10, "set-points")
        assert flight.speed_mps == 0.0


def test_a_board_speaks_mavlink_2_as_a_companion_and_numbers_what_it_says() -> None:
    """From the first message on: an autopilot answers in the version it hears."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
        autopilot.bind(("127.0.0.1", 0))
        autopilot.settimeout(PATIENCE_S)
        options = load(MavlinkSettings, {"device": f"udpout:127.0.0.1:{autopilot.getsockname()[1]}", "system_id": 7})
        body = MavlinkBody(options, BodyContext(1, load(AgentSettings, TASK), Random(1)))
        try:
            said = [autopilot.recv(300) for _ in range(2)]
        finally:
            body.close()
    heartbeats = [common.MAVLink(None).decode(bytearray(data)) for data in said]
    assert [data[0] for data in said] == [common.PROTOCOL_MARKER_V2] * 2
    assert [message.get_seq() for message in heartbeats] == [0, 1]
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in heartbeats} == {(7, 191)}
    assert {message.type for message in heartbeats} == {common.MAV_TYPE_ONBOARD_CONTROLLER}


def test_bytes_that_are_no_message_do_no_harm() -> None:
    """As from a serial line at the wrong rate, or a stranger on the port."""
    with a_body() as (body, flight):
        flight.tell("noise")
        go(body, 1.0, 0.0, lambda: flight.at[0] > 1.0, "a metre to the east")
        assert body.sense(0.0).fault == ""


def test_no_set_point_leads_out_of_the_fence() -> None:
    """Pushed against it for long, the vehicle stays within; back in it may go."""
    fence = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]]
    with a_body(fence_m=fence, ahead_s=0.5) as (body, flight):
        go(body, 2.0, 0.0, lambda: flight.at[0] > 1.5 and flight.speed_mps == 0.0, "a stand at the fence")
        sent = flight.track[-1][5]
        go(body, 2.0, 0.0, lambda: flight.track[-1][5] > sent + 20, "twenty further set-points")
        assert max(row[2] for row in flight.track) < 3.0
        assert flight.speed_mps == 0.0
        go(body, -2.0, 0.0, lambda: flight.at[0] < 0.0, "the way back")


@pytest.mark.parametrize(
    ("word", "fault", "back"),
    [("disarm", "not armed", "arm"), ("blind", "no position", "see"), ("loiter", "mode LOITER", "guided")],
)
def test_a_vehicle_that_is_not_well_says_so_and_recovers(word: str, fault: str, back: str) -> None:
    """A pilot takes it back by disarming or leaving the mode; a lost position is no place to act on."""
    with a_body() as (body, flight):
        flight.tell(word)
        wait_until(lambda: fault in body.sense(0.0).fault, f"a fault: {fault}")
        flight.tell(back)
        wait_until(lambda: not body.sense(0.0).fault, "a vehicle that is well")


def mavlink_table(port: int, air_port: int, folder: Path, **body: Any) -> dict[str, Any]:
    """A board with that vehicle: its arena's corner is 1 m south-west of where the vehicle begins."""
    table = board_table(1, (0.0, 0.0), {"listen": [endpoint(air_port)]}, folder)
    options = {
        "device": f"udpin:127.0.0.1:{port}",
        "origin_north_m": -1.0,
        "origin_east_m": -1.0,
        "max_speed_mps": 2.0,
        "stall_s": 0.3,
    }
    table["agent"] = TASK
    table["body"] = {"kind": "mavlink", "arrive_m": 0.3, "options": options, **body}
    return table


def root_says(
    counter: int, at: tuple[float, float], table: tuple[Descendant, ...], order: RecruitmentOrder | None
) -> bytes:
    """A frame of root 0, with its pulse going on."""
    at_cm = (round(100 * at[0]), round(100 * at[1]))
    frame = Member(0, *at_cm, False, (0,), counter, 0, table, (), (), order)
    return encode_sample(Sample(counter, encode(frame)))


def test_a_recruited_vehicle_flies_to_its_place(tmp_path: Path) -> None:
    """A whole board: it joins a root that the test plays, is ordered elsewhere, flies there, and joins again."""
    port, air_port = free_port(), free_port()
    place = (8.0, 4.0)
    key = f"deltaswarm/{RUN}/agent/0/radio"
    with boards(tmp_path) as running, flying(port) as flight, listening(endpoint(air_port)) as listener:
        running.start(mavlink_table(port, air_port, tmp_path))
        wait_until(lambda: 1 in listener.alive, "the board on the air")
        counter = 0

        def beat(at: tuple[float, float], order: RecruitmentOrder | None = None) -> None:
            nonlocal counter
            counter += 1
            frame = listener.radio.get(1)
            mine = type(frame) is Member and frame.path == (0, 1)
            rows = (Descendant(1, 0, frame.x_cm, frame.y_cm, 0),) if mine and frame else ()
            listener.session.put(key, root_says(counter, at, rows, order))
            time.sleep(STEP_S)  # the pace of the root's own steps, not a wait for anything

        def until(condition: Any, at: Any, order: RecruitmentOrder | None, what: str) -> None:
            deadline = time.monotonic() + PATIENCE_S
            while not condition():
                assert time.monotonic() < deadline, (what, flight.at, listener.radio, running.said(1))
                beat(at() if callable(at) else at, order)

        # It walks within the arena; a root that appears out of range and then near is newly in range.
        wait_until(lambda: flight.track and flight.speed_mps > 0, "the walk")
        for _ in range(6):
            beat((flight.at[0] + 1.0 + 15.0, flight.at[1] + 1.0))
        root_at = (10.0, 8.0)
        until(lambda: listener.path(1) == (0, 1), root_at, None, "a member")
        order = RecruitmentOrder(1, round(100 * place[0]), round(100 * place[1]), 1, 12)
        until(lambda: type(listener.radio[1]).__name__ == "Relocating", root_at, order, "a mover")
        until(lambda: listener.path(1) == (0, 1), root_at, None, "a member at its place")
        arena_at = (flight.at[0] + 1.0, flight.at[1] + 1.0)
        assert math.dist(arena_at, place) < 0.5
        beat(root_at)
        listener.session.put(key, encode_sample(Sample(counter + 1, encode(Leaving(0, 1000, 800)))))
        listener.wait_for(lambda: listener.path(1) == (), "a free agent, after its root has left")
        assert running.stop(1) == 0


class Stalling(MavlinkBody):
    def sense(self, time_s: float) -> Any:
        wait_until(lambda: not Path("stall").exists(), "the end of the stall")
        return super().sense(time_s)


def moving(flight: Flight) -> bool:
    return bool(flight.track) and flight.speed_mps > 0.5


def test_a_whole_board_that_stalls_or_freezes_has_its_vehicle_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hanging agent is caught by the body's watchdog; a frozen process by the vehicle's own failsafe."""
    root = str(Path(__file__).parents[4])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", root, prepend=os.pathsep)
    port = free_port()
    table = mavlink_table(port, free_port(), tmp_path, kind="tests.unit.agent.bodies.test_mavlink:Stalling")
    with boards(tmp_path) as running, flying_from(root, port) as flight:
        process = running.start(table)
        wait_until(lambda: moving(flight), "the walk")
        for stall, recover in (
            (lambda: Path("stall").touch(), lambda: Path("stall").unlink()),
            (lambda: process.send_signal(signal.SIGSTOP), lambda: process.send_signal(signal.SIGCONT)),
        ):
            stall()
            wait_until(lambda: flight.speed_mps == 0.0, "a stand")
            recover()
            wait_until(lambda: moving(flight), "the walk again")
        assert running.stop(1) == 0
        wait_until(lambda: flight.speed_mps == 0.0, "a stand at the end")


@contextmanager
def flying_from(root: str, port: int) -> Iterator[Flight]:
    """A vehicle started where the tests are, though the test works elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        with flying(port) as flight:
            yield flight


def test_events_of_a_file_are_sensed_from_the_vehicles_place(tmp_path: Path) -> None:
    file = tmp_path / "events.csv"
    file.write_text("event,x_m,y_m,work_s\n4,1,1,2\n5,19,19,2\n")
    with a_body(events=str(file)) as (body, _):
        assert body.sense(0.0).events == (Event(4, 1.0, 1.0),)
        body.move(0.0, 0.0, (4, 5))
        assert body.sense(1.9).events
        assert not body.sense(2.1).events
