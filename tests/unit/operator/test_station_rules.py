"""Whom the station lets in: names and addresses of hosts."""

import json
import socket

import pytest

from deltaswarm_operator.station import rules
from deltaswarm_operator.station.visitors import host_in_url
from deltaswarm_scenario.page_messages import MAX_BYTES, RefusedError


def test_an_address_for_all_interfaces_is_one_by_which_the_machine_is_reached() -> None:
    with socket.create_server(("0.0.0.0", 0)) as server:
        host = host_in_url("0.0.0.0")
        socket.create_connection((host, server.getsockname()[1]), 5).close()
    assert host != "0.0.0.0"
    assert (host_in_url("::1"), host_in_url("lab.example.org")) == ("[::1]", "lab.example.org")


def test_hosts_that_are_ours() -> None:
    """Names only if they were asked for; addresses where others may come."""
    assert rules.is_our_host("127.0.0.1:8000", "127.0.0.1")
    assert rules.is_our_host("[::1]:8000", "::1")
    assert not rules.is_our_host("192.168.1.2:8000", "127.0.0.1")
    assert rules.is_our_host("192.168.1.2:8000", "0.0.0.0")
    assert rules.is_our_host("station.lab:8000", "station.lab")
    assert not rules.is_our_host("evil.example", "0.0.0.0")
    for strange in (None, "", "[", "[::1", "@", "a@127.0.0.1.evil.example"):
        assert not rules.is_our_host(strange, "127.0.0.1")


def test_each_role_has_its_own_address() -> None:
    """A watcher's follows from the participant's, and not the other way round; nothing else is let in."""
    watch = rules.watch_token("secret")
    tokens = {rules.OPERATE: "secret", rules.WATCH: watch}
    assert rules.watch_token("secret") == watch != rules.watch_token("other")
    assert "secret" not in watch
    assert rules.role_and_path(tokens, "/secret/live?x") == (rules.OPERATE, "live")
    assert rules.role_and_path(tokens, f"/{watch}/map.js") == (rules.WATCH, "map.js")
    for path in (f"/{rules.watch_token(watch)}/live", "/", "", "/secret", f"//{watch}/", f"/{watch[:-1]}/"):
        assert rules.role_and_path(tokens, path) is None
    assert rules.role_and_path({rules.OPERATE: "secret"}, f"/{watch}/live") is None


def test_long_answers_to_a_form_pass_whole() -> None:
    """Twenty texts of the greatest length, in letters of three bytes, in one datagram; what is too long is refused."""
    answers = {f"question {number}": "ア" * 2000 for number in range(20)}
    text = json.dumps({"type": "form", "form": "f", "answers": answers}, ensure_ascii=False)
    datagram = rules.intent_of(text, 1)
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with near, far:
        near.send(datagram, socket.MSG_DONTWAIT)
        assert json.loads(far.recv(1 << 20))["answers"] == answers
    with pytest.raises(RefusedError, match="bytes long"):
        rules.intent_of(json.dumps({"type": "form", "form": "f", "answers": {"a": "x" * 2 * MAX_BYTES}}), 1)
