"""Who speaks as whom in open air over TLS, where the agents' numbers are given: each as its certificate says."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from deltaswarm_board.settings import BoardSettings
from deltaswarm_operator.__main__ import _open_air, open_air_parser
from deltaswarm_orchestrator.processes import certificates
from deltaswarm_orchestrator.processes.certificates import Authority
from deltaswarm_wire.access import air_rules
from deltaswarm_wire.checked import load
from deltaswarm_wire.commands import BASE_ID
from deltaswarm_wire.keys import AGENT, HEALTH, RADIO, REPORT, Keys
from deltaswarm_wire.session import configured
from tests.support.boards import tls_arguments, tls_table
from tests.support.fields import RUN, free_port
from tests.support.swarms import wait_until

KEYS = Keys(RUN)
TRUE, FALSE = b"true", b"false"

Heard = list[tuple[str, bytes]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("certificates")
    certificates.make(made, range(6), [], 1)
    return made


def endpoint(port: int) -> str:
    return f"tls/127.0.0.1:{port}"


def board(folder: Path, agent: int, agents: str = "", **air: Any) -> BoardSettings:
    tls = tls_table(folder, f"agent-{agent}", verify_name=False)
    return load(BoardSettings, {"id": agent, "run": RUN, "air": {"agents": agents, "tls": tls, **air}})


def opened(settings: BoardSettings) -> zenoh.Session:
    return zenoh.open(configured(zenoh.Config, settings.pairs, settings.air.link(settings.user)))


@contextmanager
def operator(folder: Path, out: Path, *arguments: str) -> Iterator[zenoh.Session]:
    command = ["--no-world", "--run", RUN, "--out", str(out), *tls_arguments(folder, "operator"), *arguments]
    config = _open_air(open_air_parser().parse_args(command)).config
    with zenoh.open(configured(zenoh.Config, config.pairs, config.link)) as session:
        yield session


def listen(session: zenoh.Session, key: str) -> Heard:
    heard: Heard = []
    session.declare_subscriber(key, lambda sample: heard.append((str(sample.key_expr), sample.payload.to_bytes())))
    return heard


def watch(session: zenoh.Session) -> list[str]:
    seen: list[str] = []
    session.liveliness().declare_subscriber(
        KEYS.token(AGENT, "*"), lambda sample: seen.append(str(sample.key_expr)), history=True
    )
    return seen


def speak(session: zenoh.Session, agent: int, leaf: str, data: bytes, heard: Heard) -> None:
    key = KEYS.agent(agent, leaf)
    wait_until(lambda: session.put(key, data) or (key, data) in heard, f"agent {agent}'s {leaf}")


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_with_the_certificate_of_agent_3_one_cannot_speak_as_agent_4_to_the_operator(
    mode: str, folder: Path, tmp_path: Path
) -> None:
    """Neither a report, nor a word of health, nor a token; agent 4 can, and so can agent 3 as itself."""
    port = free_port()
    arguments = ("--mode", mode, "--listen", endpoint(port), "--agents", "3-4")
    way = {"connect": [endpoint(port)], "mode": "peer" if mode == "peer" else "client"}
    with operator(folder, tmp_path / "out", *arguments) as hears, ExitStack() as stack:
        heard, seen = listen(hears, KEYS.all_reports), watch(hears)
        ill = listen(hears, KEYS.all_health)
        three, four = (stack.enter_context(opened(board(folder, agent, **way))) for agent in (3, 4))
        three.liveliness().declare_token(KEYS.token(AGENT, 4))
        for leaf, at_operator in ((REPORT, heard), (HEALTH, ill)):
            three.put(KEYS.agent(4, leaf), FALSE)
            speak(three, 3, leaf, TRUE, at_operator)
            three.put(KEYS.agent(4, leaf), FALSE)
        three.liveliness().declare_token(KEYS.token(AGENT, 3))
        wait_until(lambda: KEYS.token(AGENT, 3) in seen, "agent 3's token")
        assert KEYS.token(AGENT, 4) not in seen
        four.liveliness().declare_token(KEYS.token(AGENT, 4))
        wait_until(lambda: KEYS.token(AGENT, 4) in seen, "agent 4's token")
        speak(four, 4, REPORT, TRUE, heard)
        assert {data for _, data in heard + ill} == {TRUE}


def test_nor_to_another_board(folder: Path) -> None:
    """Where both are peers; a number that is not among those that may be there is not heard at all."""
    port = free_port()
    with ExitStack() as stack:
        hears = stack.enter_context(opened(board(folder, 0, "0,3,4", listen=[endpoint(port)])))
        heard = listen(hears, KEYS.all_radio)
        three, four, five = (
            stack.enter_context(opened(board(folder, agent, connect=[endpoint(port)]))) for agent in (3, 4, 5)
        )
        for session, agent in ((five, 5), (three, 4), (four, 3)):
            session.put(KEYS.agent(agent, RADIO), FALSE)
        speak(three, 3, RADIO, TRUE, heard)
        speak(four, 4, RADIO, TRUE, heard)
        for session, agent in ((five, 5), (three, 4), (four, 3)):
            session.put(KEYS.agent(agent, RADIO), FALSE)
        speak(three, 3, RADIO, b"last", heard)
        speak(four, 4, RADIO, b"last", heard)
        assert {data for _, data in heard} == {TRUE, b"last"}


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_boards_that_know_each_other_hear_each_other(mode: str, folder: Path, tmp_path: Path) -> None:
    """Frames and reports go their ways where all have the rules: directly, and through an operator that is a router."""
    ports = free_port(), free_port()
    router = ("--mode", "router" if mode == "client" else "peer", "--listen", endpoint(ports[0]), "--agents", "0-1")
    ways: list[dict[str, Any]] = [{"mode": mode, "connect": [endpoint(ports[0])]} for _ in range(2)]
    if mode == "peer":
        ways[0]["listen"] = [endpoint(ports[1])]
        ways[1]["connect"].append(endpoint(ports[1]))
    with operator(folder, tmp_path / "out", *router) as hears, ExitStack() as stack:
        reports, seen = listen(hears, KEYS.all_reports), watch(hears)
        made = []
        for agent, way in enumerate(ways):
            made.append(stack.enter_context(opened(board(folder, agent, "0-1", **way))))
        heard = [listen(session, KEYS.all_radio) for session in made]
        for agent, session in enumerate(made):
            session.liveliness().declare_token(KEYS.token(AGENT, agent))
            speak(session, agent, RADIO, TRUE, heard[1 - agent])
            speak(session, agent, REPORT, TRUE, reports)
        wait_until(lambda: {*seen} == {KEYS.token(AGENT, agent) for agent in range(2)}, "both tokens")


def test_only_the_operator_sends_what_leaves_its_base(folder: Path, tmp_path: Path) -> None:
    at, port = free_port(), free_port()
    with (
        operator(folder, tmp_path / "out", "--listen", endpoint(at), "--agents", "0,3") as base,
        opened(board(folder, 0, "0,3", listen=[endpoint(port)], connect=[endpoint(at)])) as hears,
        opened(board(folder, 3, "0,3", connect=[endpoint(port)])) as three,
    ):
        heard = listen(hears, KEYS.all_radio)
        speak(three, 3, RADIO, TRUE, heard)
        three.put(KEYS.agent(BASE_ID, RADIO), FALSE)
        speak(base, BASE_ID, RADIO, TRUE, heard)
        three.put(KEYS.agent(BASE_ID, RADIO), FALSE)
        speak(three, 3, RADIO, b"last", heard)
        assert {data for _, data in heard} == {TRUE, b"last"}


def test_a_link_between_boards_ends_with_the_certificate_of_either(tmp_path: Path) -> None:
    """Whoever of the two listens; over `quic/` as over `tls/`."""
    certificates.make(tmp_path, [0], [], 1)
    certificates.write_pair(tmp_path / "agent-3", *Authority.load(tmp_path).sign("agent-3", days=15 / 86400))
    with ExitStack() as stack:
        sessions = []
        for protocol, listens, connects in (("tls", 0, 3), ("tls", 3, 0), ("quic", 0, 3)):
            at = f"{protocol}/127.0.0.1:{free_port()}"
            sessions.append(stack.enter_context(opened(board(tmp_path, listens, listen=[at]))))
            sessions.append(stack.enter_context(opened(board(tmp_path, connects, connect=[at]))))
        for count in (1, 0):
            wait_until(
                lambda count=count: all(len(session.info.peers_zid()) == count for session in sessions),
                f"{count} link each",
            )


def test_without_numbers_there_are_no_rules(folder: Path) -> None:
    settings = board(folder, 3, listen=[endpoint(1)])
    assert "access_control" not in dict(settings.pairs)
    assert dict(board(folder, 3, "3-4", listen=[endpoint(1)]).pairs)["access_control"] == air_rules(KEYS, [3, 4], ())


def test_an_agent_more_costs_two_rules() -> None:
    """What all may is said once for all: a board has 40 MB for everything, and each rule takes its share."""
    few, many = (air_rules(KEYS, range(count), ()) for count in (5, 25))
    assert len(many["rules"]) - len(few["rules"]) == 2 * 20
    assert sum(len(policy["rules"]) for policy in many["policies"]) == len(many["rules"])


def test_numbers_need_certificates(tmp_path: Path) -> None:
    command = ["--no-world", "--run", RUN, "--out", str(tmp_path), "--listen", "tcp/127.0.0.1:1", "--agents", "0-3"]
    with pytest.raises(ValueError, match=r"--agents must .*certificates"):
        _open_air(open_air_parser().parse_args(command))
