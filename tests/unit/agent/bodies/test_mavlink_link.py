"""The links to an autopilot, and the names of its modes, by themselves."""

import os
import socket
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from deltaswarm_agent.body import BodyContext
from deltaswarm_board.bodies.mavlink import MavlinkBody
from deltaswarm_board.bodies.mavlink_link import (
    Device,
    MavlinkLink,
    SerialLink,
    TcpLink,
    UdpLink,
    open_link,
    parse_device,
)
from deltaswarm_board.bodies.mavlink_settings import MODES, MavlinkSettings, mode_name
from deltaswarm_wire.checked import SettingsError, load
from deltaswarm_wire.settings import AgentSettings
from tests.support.fields import free_port
from tests.support.swarms import PATIENCE_S, wait_until
from tests.support.tiers import in_one_test

LOCAL = "127.0.0.1"
IPV6 = Path("/proc/net/if_inet6")
HAS_IPV6 = IPV6.exists() and " lo\n" in IPV6.read_text()


@in_one_test(
    ("text", "device"),
    [
        ("udpin:0.0.0.0:14540", Device("udpin", "0.0.0.0", 14540)),
        ("udp:127.0.0.1:14550", Device("udpin", "127.0.0.1", 14550)),
        ("udpout:autopilot.local:14555", Device("udpout", "autopilot.local", 14555)),
        ("tcp:127.0.0.1:5760", Device("tcp", "127.0.0.1", 5760)),
        ("udpin:[::1]:14550", Device("udpin", "::1", 14550)),
        ("tcp:[fe80::1%eth0]:5760", Device("tcp", "fe80::1%eth0", 5760)),
        ("udpin:::1:14550", ValueError),
        ("udpin:[::1:14550", ValueError),
        ("udpin:[127.0.0.1]:14550", ValueError),
        ("/dev/ttyACM0", Device("serial", "/dev/ttyACM0", 57600)),
        ("/dev/serial/by-id/usb-a,b:c", ValueError),
        ("/dev/ttyAMA0,921600", Device("serial", "/dev/ttyAMA0", 921600)),
        ("/dev/ttyAMA0,99999999999", ValueError),
        ("udpin:14540", ValueError),
        ("tcp:127.0.0.1:0", ValueError),
        ("tcp:127.0.0.1:65536", ValueError),
        ("tcp", ValueError),
        ("ttyACM0", ValueError),
        ("", ValueError),
    ],
)
def test_connection_strings_mean_what_they_do_elsewhere(text: str, device: Device | type[Exception]) -> None:
    """A string that means nothing here is a mistake in the board's file, found before anything moves."""
    if isinstance(device, Device):
        assert parse_device(text, 57600) == device
    else:
        with pytest.raises(ValueError, match=r"^must "):
            parse_device(text, 57600)
        with pytest.raises(SettingsError, match="device"):
            load(MavlinkSettings, {"device": text})


def received(link: MavlinkLink, length: int) -> bytes:
    data = b""
    while len(data) < length:
        more = link.receive(PATIENCE_S)
        assert more, f"nothing within {PATIENCE_S} s after {data!r}"
        data += more
    return data


@pytest.mark.parametrize("host", [LOCAL, "[::1]", "localhost"])
def test_udp_sends_to_its_peer_alone(host: str) -> None:
    """Whoever else speaks, and nothing before there is one; an autopilot that restarts speaks from another port."""
    if host == "[::1]" and not HAS_IPV6:
        pytest.skip("no IPv6 here")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOCAL, 0))
        port = probe.getsockname()[1]
    link = open_link(parse_device(f"udpin:{host}:{port}", 57600))
    try:
        assert isinstance(link, UdpLink)
        link.write(b"lost")
        assert link.receive(0.01) == b""
        for _ in range(2):
            autopilot = open_link(parse_device(f"udpout:{host}:{port}", 57600))
            autopilot.open()
            autopilot.write(b"hello")
            assert received(link, 5) == b"hello"
            link.peer = link.sender
            stranger = open_link(parse_device(f"udpout:{host}:{port}", 57600))
            stranger.open()
            stranger.write(b"x")
            assert received(link, 1) == b"x"
            assert link.sender != link.peer
            link.write(b"go")
            assert received(autopilot, 2) == b"go"
            assert stranger.receive(0.01) == b""
            stranger.close()
            autopilot.close()
    finally:
        link.close()


def test_tcp_opens_again_after_the_other_end_hung_up() -> None:
    """The break is told, what is written meanwhile is lost, and the next one is tried by itself."""
    with socket.create_server((LOCAL, 0)) as server:
        link = open_link(Device("tcp", *server.getsockname()))
        try:
            assert isinstance(link, TcpLink)
            link.open()
            for _ in range(2):
                autopilot, _ = server.accept()
                with autopilot:
                    autopilot.sendall(b"hello")
                    assert received(link, 5) == b"hello"
                    link.write(b"go")
                    assert autopilot.recv(10) == b"go"
                    assert link.receive(0.01) == b""
                with pytest.raises(ConnectionResetError):
                    link.receive(PATIENCE_S)
                link.write(b"lost")
                assert link.receive(0.01) == b"", "open again"
        finally:
            link.close()


def test_a_serial_line_that_is_pulled_out_is_told_of_and_found_again() -> None:
    """Played by a pseudo-terminal, whose other end goes."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    link = open_link(Device("serial", os.ttyname(theirs), 57600))
    try:
        assert isinstance(link, SerialLink)
        link.open()
        os.write(ours, b"hello")
        assert received(link, 5) == b"hello"
        link.write(b"go")
        assert os.read(ours, 10) == b"go"
        assert link.receive(0.01) == b""
        os.close(theirs)
        os.close(ours)
        with pytest.raises(OSError, match=r"disconnected|error"):
            link.receive(PATIENCE_S)
        link.write(b"lost")
        with pytest.raises(OSError, match="open"):
            link.receive(PATIENCE_S)
    finally:
        link.close()


@contextmanager
def a_body(device: str) -> Iterator[MavlinkBody]:
    body = MavlinkBody(load(MavlinkSettings, {"device": device}), BodyContext(1, AgentSettings(), Random(1)))
    try:
        yield body
    finally:
        body.close()


def test_a_body_whose_autopilot_is_not_up_yet_says_so_and_finds_it_later() -> None:
    """Refused connections end nothing; the first thing that an autopilot hears then is a heartbeat."""
    port = free_port()
    with a_body(f"tcp:{LOCAL}:{port}") as body:
        wait_until(lambda: body.sense(0.0).fault == f"no link to tcp:{LOCAL}:{port}: Connection refused", "a fault")
        with socket.create_server((LOCAL, port)) as server, server.accept()[0] as autopilot:
            assert autopilot.recv(1)[0] == common.PROTOCOL_MARKER_V2
            wait_until(lambda: "no heartbeat" in body.sense(0.0).fault, "a link")


def test_a_body_whose_serial_device_is_not_there_says_so_and_finds_it_later(tmp_path: Path) -> None:
    """Whether there is none, or what is there is no serial line."""
    device = tmp_path / "ttyACM7"
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    try:
        with a_body(str(device)) as body:
            wait_until(lambda: f"no link to {device}: could not open port" in body.sense(0.0).fault, "a fault")
            device.symlink_to("/dev/null")
            wait_until(lambda: "Could not configure port" in body.sense(0.0).fault, "another fault")
            device.unlink()
            device.symlink_to(os.ttyname(theirs))
            assert os.read(ours, 1)[0] == common.PROTOCOL_MARKER_V2
            wait_until(lambda: "no heartbeat" in body.sense(0.0).fault, "a link")
    finally:
        os.close(theirs)
        os.close(ours)


@pytest.mark.parametrize("device", ["udpin:a..b:14550", "tcp:a..b:5760", "/dev/tty\0"])
def test_a_name_that_can_be_none_breaks_the_link_and_nothing_else(device: str) -> None:
    """Whatever Python raises for it, the vehicle's thread goes on."""
    with pytest.raises(OSError):  # noqa: PT011 (each has its own words)
        open_link(parse_device(device, 57600)).open()


def test_a_rate_that_a_serial_device_refuses_breaks_the_link_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """As pyserial tells of it, which is not as of a device that is not there."""

    def refuse(*_: Any, **__: Any) -> None:
        raise ValueError("Failed to set custom baud rate")

    monkeypatch.setattr("serial.Serial", refuse)
    with pytest.raises(OSError, match="Failed to set"):
        open_link(Device("serial", "/dev/ttyACM7", 1201)).open()


def test_modes_have_the_names_that_pymavlink_gives_them() -> None:
    """By its own function, which costs a board too much memory: for all vehicles and modes that it can name here."""
    from pymavlink import mavutil

    from deltaswarm_board.bodies import mavlink_settings

    vehicles = mavlink_settings._ARDUPILOT
    ardupilot, px4 = mavutil.mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavutil.mavlink.MAV_AUTOPILOT_PX4

    def theirs(autopilot: int, vehicle: int, base_mode: int, custom_mode: int) -> str:
        heartbeat = mavutil.mavlink.MAVLink_heartbeat_message(vehicle, autopilot, base_mode, custom_mode, 4, 3)
        name: str = mavutil.mode_string_v10(heartbeat)
        return name

    for vehicle, modes in vehicles.items():
        for number in [*modes, 200]:
            said = (ardupilot, vehicle, 1, number)
            assert mode_name(*said) == theirs(*said), said
    for main in range(12):
        for sub in range(12):
            said = (px4, 2, 1, main << 16 | sub << 24)
            assert mode_name(*said) == theirs(*said), said
    assert mode_name(ardupilot, 2, 0x40, 4) == theirs(ardupilot, 2, 0x40, 4)


def test_modes_are_named_in_any_case_and_one_that_no_autopilot_has_is_refused() -> None:
    """Else the agent would wait for ever for a mode that cannot come."""
    assert load(MavlinkSettings, {"modes": ["guided", "OffBoard"]}).limits(1.0).modes == ("GUIDED", "OFFBOARD")
    numbers = ("Mode(200)", "Mode(0x0000001f)")  # as `mode_name` calls what it does not know
    assert load(MavlinkSettings, {"modes": [numbers[0].upper(), numbers[1]]}).limits(1.0).modes == numbers
    for mode in MODES:
        assert load(MavlinkSettings, {"modes": [mode]}).limits(1.0).modes == (mode,)
    with pytest.raises(SettingsError, match=r"^modes must .*ACRO, .*'GUIDE', 'UNKNOWN'"):
        load(MavlinkSettings, {"modes": ["GUIDE", "GUIDED", "UNKNOWN"]})
