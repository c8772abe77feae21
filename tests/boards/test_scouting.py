"""Boards that find each other: by multicast, and through a peer that they share."""

import socket
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh

from deltaswarm_board.settings import AirSettings
from deltaswarm_orchestrator.processes import certificates
from deltaswarm_wire.checked import load
from deltaswarm_wire.session import MAX_AIR_BYTES, RouterLink, air_pairs, configured
from tests.support.fields import EVENT_AT, board_table, boards, endpoint, free_port
from tests.support.swarms import wait_until

FAST = ("--accelerate", "20")
GROUP = "224.0.0.224"
"""Zenoh's own."""


def multicasts() -> bool:
    """Whether what is sent to the group over loopback comes back over it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("", 0))
        end.settimeout(1.0)
        try:
            loopback = socket.inet_aton("127.0.0.1")
            end.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + loopback)
            end.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
            end.sendto(b"?", (GROUP, end.getsockname()[1]))
            return end.recv(1) == b"?"
        except OSError:
            return False


@pytest.mark.processes
@pytest.mark.parametrize("certified", [False, True])
def test_boards_find_each_other_by_multicast(certified: bool, tmp_path: Path) -> None:
    """With no endpoint in their files: who is found listens somewhere, with certificates over TLS."""
    if not multicasts():
        pytest.skip("no multicast over loopback on this machine")
    group = {"scouting/multicast/address": f'"{GROUP}:{free_port()}"', "scouting/multicast/interface": '"lo"'}
    with boards(tmp_path) as running:
        certificates.make(tmp_path, range(2), [], 1)
        for agent in range(2):
            files = {"ca_file": "ca.pem", "cert_file": f"agent-{agent}.pem", "key_file": f"agent-{agent}.key"}
            tls = {"tls": {**files, "verify_name": False}} if certified else {}
            table = board_table(agent, EVENT_AT, {"multicast": True, "zenoh": group, **tls}, tmp_path)
            running.start({**table, "log": {"every_s": 5.0}}, *FAST)
        for agent in range(2):
            wait_until(lambda agent=agent: has_heard(running.said(agent)), "a neighbour")


def has_heard(said: str) -> bool:
    return any("heard " in line and "heard 0;" not in line for line in said.splitlines())


def opened(user: str = "agent-3", **air: Any) -> zenoh.Session:
    settings = load(AirSettings, air)
    return zenoh.open(configured(zenoh.Config, settings.pairs(user), settings.link(user)))


def test_passwords_are_asked_for_among_peers(tmp_path: Path) -> None:
    """Who has none, or a wrong one, or is unknown, has no link; who comes last and is right has one."""
    known = "agent-0:zero\nagent-3:three\n"
    files = []
    for number, text in enumerate((known, known.replace("three", "guess"), known + "agent-9:nine\n")):
        files.append(tmp_path / str(number))
        files[-1].touch(mode=0o600)
        files[-1].write_text(text)
    right, wrong, unknown = ({"credentials_file": str(file)} for file in files)
    port = free_port()
    to = {"connect": [endpoint(port)]}
    with ExitStack() as sessions:
        first = sessions.enter_context(opened("agent-0", listen=[endpoint(port)], **right))
        for user, secret in (("agent-3", {}), ("agent-3", wrong), ("agent-9", unknown)):
            sessions.enter_context(opened(user, **to, **secret))
        last = sessions.enter_context(opened("agent-3", **to, **right))
        wait_until(lambda: last.zid() in first.info.peers_zid(), "a link")
        assert first.info.peers_zid() == [last.zid()]


@pytest.mark.parametrize("gossip", [True, False])
def test_gossip_joins_peers_that_share_one(gossip: bool) -> None:
    """Two that know the one in the middle alone have a link of their own; without it they never hear each other."""
    ports = [free_port(), free_port()]
    heard: list[bytes] = []
    with (
        opened(listen=[endpoint(ports[0])], gossip=gossip) as first,
        opened(listen=[endpoint(ports[1])], connect=[endpoint(ports[0])], gossip=gossip) as middle,
        opened(connect=[endpoint(ports[1])], gossip=gossip) as last,
    ):
        for session in (first, middle):
            session.declare_subscriber("a", lambda sample: heard.append(sample.payload.to_bytes()))
        wait_until(lambda: len(middle.info.peers_zid()) == 2, "both links of the middle")
        if gossip:
            wait_until(lambda: last.zid() in first.info.peers_zid(), "a link of their own")
            wait_until(lambda: last.put("a", b"!") or heard.count(b"!") > 1, "a sample at both")
        wait_until(lambda: last.put("a", b"!") or heard, "a sample at the middle")
        assert (last.zid() in first.info.peers_zid()) == gossip


@pytest.mark.parametrize(
    ("air", "listen", "protocols"),
    [
        ({"multicast": True}, ["tcp/0.0.0.0:0"], None),
        ({"multicast": True, "listen": ["tcp/0.0.0.0:7"]}, ["tcp/0.0.0.0:7"], None),
        ({"multicast": True, "tls": True}, ["tls/0.0.0.0:0"], ["tls"]),
        ({"gossip": True, "connect": ["tcp/10.0.0.1:7"], "tls": True}, [], ["tcp", "tls"]),
        ({"mode": "client", "multicast": True, "connect": ["tls/10.0.0.1:7"], "tls": True}, [], ["tls"]),
    ],
)
def test_who_is_found_comes_the_same_way(
    air: dict[str, Any], listen: list[str], protocols: list[str] | None, tmp_path: Path
) -> None:
    """With certificates nobody is spoken to without, unless an endpoint in the file says so."""
    if "tls" in air:
        names = ("ca_file", "cert_file", "key_file")
        for name in names:
            (tmp_path / name).touch(mode=0o600)
        air = {**air, "tls": {name: str(tmp_path / name) for name in names}}
    pairs = dict(load(AirSettings, air).pairs("agent-3"))
    assert pairs["listen/endpoints"] == listen
    assert pairs.get("transport/link/protocols") == protocols


def test_who_sends_too_much_at_once_is_cut_off() -> None:
    """Before it is put together in a board's memory; what is as large as any message passes."""
    port = free_port()
    heard: list[int] = []
    link = RouterLink(endpoint(port))
    open_air = configured(zenoh.Config, air_pairs("peer", [], [endpoint(port)]), link)
    over_the_link = ("transport/shared_memory/enabled", False)  # else large samples of this machine need none
    stranger = configured(zenoh.Config, [*air_pairs("peer", [endpoint(port)], []), over_the_link], link)
    with zenoh.open(open_air) as board, zenoh.open(stranger) as session:
        board.declare_subscriber("a", lambda sample: heard.append(len(sample.payload)))
        publisher = session.declare_publisher("a", congestion_control=zenoh.CongestionControl.BLOCK)
        wait_until(lambda: publisher.matching_status.matching, "a link")
        for length in (MAX_AIR_BYTES // 2, 2 * MAX_AIR_BYTES):
            publisher.put(bytes(length))
        wait_until(lambda: publisher.put(b"mark") or 4 in heard, "the link again")
    assert {*heard} == {MAX_AIR_BYTES // 2, 4}
