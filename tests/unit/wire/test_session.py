"""Zenoh sessions: their endpoints, and what they start from."""

import argparse
import errno
import json
import logging
import os
import re
import socket

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_cli.main import main
from deltaswarm_wire.arguments import connects_to, listens_on
from deltaswarm_wire.logs import LogFormatter
from deltaswarm_wire.session import WITH_PORT, RouterLink, client_pairs, configured, endpoint_problem, host_and_port
from tests.support.tiers import in_one_test

SHARED_MEMORY = "transport/shared_memory/enabled"
LINK = RouterLink("tcp/127.0.0.1:7447")


def test_shared_memory_is_off_unless_the_user_asks_for_it() -> None:
    assert json.loads(configured(zenoh.Config, [], LINK).get_json(SHARED_MEMORY)) is False
    asked = RouterLink(LINK.endpoint, overrides=((SHARED_MEMORY, "true"),))
    assert json.loads(configured(zenoh.Config, client_pairs(asked), asked).get_json(SHARED_MEMORY)) is True


@pytest.mark.parametrize("setting", [("no/such", "1"), ("mode", "}")], ids=["unknown", "malformed"])
def test_a_refused_setting_shows_no_rust_source(setting: tuple[str, str]) -> None:
    with pytest.raises(ValueError, match="Zenoh") as refusal:
        configured(zenoh.Config, [], RouterLink(LINK.endpoint, overrides=(setting,)))
    assert ".rs" not in str(refusal.value)
    assert setting[0] in str(refusal.value)


def test_a_log_shows_no_rust_source() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        pairs = [("mode", "router"), ("listen/endpoints", [endpoint])]
        with pytest.raises(zenoh.ZError) as refusal:
            zenoh.open(configured(zenoh.Config, pairs, LINK))
    error = refusal.value
    assert ".rs:" in str(error), "Zenoh names no sources any more: `without_sources` is not needed"
    record = logging.LogRecord("n", logging.ERROR, "f", 1, "%s", (error,), (type(error), error, None))
    text = LogFormatter().format(record)
    assert ".rs" not in text
    assert text.count(os.strerror(errno.EADDRINUSE)) == 2


@in_one_test(
    ("endpoint", "parts"),
    [
        ("tcp/192.168.1.10:7447", ("192.168.1.10", 7447)),
        ("tls/board.local:0", ("board.local", 0)),
        ("tcp/[::1]:7447", ("::1", 7447)),
        ("udp/[fe80::1%eth0]:65535#iface=eth0", ("fe80::1%eth0", 65535)),
        ("quic/10.0.0.1:7447?prio=1", ("10.0.0.1", 7447)),
    ],
)
def test_host_and_port_are_found(endpoint: str, parts: tuple[str, int]) -> None:
    assert host_and_port(endpoint) == parts
    assert endpoint_problem(endpoint) == ""


@pytest.mark.parametrize("endpoint", ["unixsock-stream//tmp/x", "serial//dev/ttyUSB0#baudrate=115200", "vsock/-1:7447"])
def test_what_has_no_port_needs_none(endpoint: str) -> None:
    assert endpoint_problem(endpoint) == endpoint_problem(endpoint, connects=True) == ""


@in_one_test(
    ("endpoint", "word"),
    [
        ("", "PROTOCOL/ADDRESS"),
        ("nonsense", "PROTOCOL/ADDRESS"),
        ("tcp/", "PROTOCOL/ADDRESS"),
        ("tpc/0.0.0.0:7447", "tcp, udp, tls"),
        ("unixpipe/", "PROTOCOL/ADDRESS"),
        ("tcp/nonsense", "HOST:PORT"),
        ("tcp/0.0.0.0", "HOST:PORT"),
        ("tcp/:7447", "HOST:PORT"),
        ("tcp/10.0.0.1:port", "HOST:PORT"),
        ("tcp/10.0.0.1:65536", "HOST:PORT"),
        ("tcp/10.0.0.1:\N{ARABIC-INDIC DIGIT ONE}", "HOST:PORT"),
        ("tcp/::1:7447", "HOST:PORT"),
        ("tcp/10.0.0.1:7447,tcp/10.0.0.2:7447", "HOST:PORT"),
        ("tcp/10.0.0.1 :7447", "HOST:PORT"),
        ("tls/127.0.0.999:7447", "IPv4"),
        ("tcp/10.0.1:7447", "IPv4"),
    ],
)
def test_what_is_no_endpoint_is_told(endpoint: str, word: str) -> None:
    assert word in endpoint_problem(endpoint)
    for kind in (connects_to, listens_on):
        with pytest.raises(argparse.ArgumentTypeError, match=re.escape(word)):
            kind(endpoint)


def test_over_tls_nobody_connects_to_an_ipv6_address() -> None:
    """One may listen there, for those who know a name."""
    for protocol in ("tls", "quic"):
        assert endpoint_problem(f"{protocol}/[::]:7447") == ""
        assert "IPv4" in endpoint_problem(f"{protocol}/[::1]:7447", connects=True)
    assert connects_to("tcp/[::1]:7447") == listens_on("tcp/[::1]:7447") == "tcp/[::1]:7447"


@pytest.mark.parametrize(
    "command",
    [
        "run smoke --listen",
        "agent --id 1 --settings x --run x --connect",
        "world --scenario x --run x --credentials x --out x --listen",
        "operator --run x --out x --connect",
        "operator --no-world --run x --out x --connect",
        "operator --no-world --run x --out x --listen",
    ],
)
def test_every_command_checks_its_endpoints(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*command.split(), "tpc/127.0.0.1:1"])
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert f"argument {command.split()[-1]}: must be PROTOCOL/ADDRESS" in error
    assert "'tpc/127.0.0.1:1'" in error


@given(st.sampled_from(WITH_PORT), st.text(max_size=20))
def test_anything_is_taken_or_told(protocol: str, address: str) -> None:
    endpoint = f"{protocol}/{address}"
    if not endpoint_problem(endpoint):
        host, port = host_and_port(endpoint)
        assert host
        assert 0 <= port <= 65535
