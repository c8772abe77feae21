"""Who comes in over TLS, and as whom: by certificate, not by user name."""

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
import zenoh

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.processes import certificates
from deltaswarm_orchestrator.processes.certificates import Authority
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_wire.access import air_rules, user_name, world_rules
from deltaswarm_wire.arguments import tls_of
from deltaswarm_wire.certificate import certificate_problem
from deltaswarm_wire.keys import ACT, AGENT, FRAME, OPERATOR, RADIO, REPORT, Keys
from deltaswarm_wire.session import CERTIFIED, Pairs, RouterLink, client_pairs, configured, router_pairs
from deltaswarm_world.__main__ import admit_certified
from deltaswarm_world.__main__ import main as world_main
from tests.support.boards import run_with_board, tls_arguments, tls_files, usual_digest
from tests.support.complaints import Printed
from tests.support.fields import free_port
from tests.support.swarms import wait_until

KEYS = Keys("boards")
AGENTS = (3, 4)
USER, PASSWORD = "transport/auth/usrpwd/user", "transport/auth/usrpwd/password"


@dataclass
class Router:
    """A router as the world opens it, its certificates, and what reaches it."""

    folder: Path
    tls: str
    tcp: str
    session: zenoh.Session
    heard: list[tuple[str, bytes]] = field(default_factory=list)

    def link(self, name: str) -> RouterLink:
        return RouterLink(self.tls, tls=tls_files(self.folder, name))

    def sign(self, name: str, subject: str, days: float) -> RouterLink:
        certificates.write_pair(self.folder / name, *Authority.load(self.folder).sign(subject, days))
        return self.link(name)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Router]:
    folder = tmp_path_factory.mktemp("certificates")
    certificates.make(folder, AGENTS, [], 1)
    credentials = folder / "credentials"
    credentials.write_text("".join(f"{user_name(AGENT, agent)}:secret {agent}\n" for agent in AGENTS))
    endpoints = [f"tls/127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{free_port()}"]
    admit_certified(endpoints, credentials)
    link = RouterLink(endpoints[0], tls=tls_files(folder, "world"))
    pairs = router_pairs(link, str(credentials), KEYS, AGENTS, endpoints)
    with zenoh.open(configured(zenoh.Config, pairs, link)) as session:
        router = Router(folder, *endpoints, session)

        def hear(sample: zenoh.Sample) -> None:
            router.heard.append((str(sample.key_expr), sample.payload.to_bytes()))

        # In the thread that reads the link, which also notes its end: what was sent before that is heard before that.
        session.declare_subscriber(KEYS.from_agents, zenoh.handlers.Callback(hear, indirect=False))
        yield router


@pytest.fixture
def router(made: Router) -> Router:
    made.heard.clear()
    return made


def opened(link: RouterLink, pairs: Pairs | None = None) -> zenoh.Session:
    return zenoh.open(configured(zenoh.Config, pairs or client_pairs(link), link))


def without(pairs: Pairs, *parts: str) -> Pairs:
    return [pair for pair in pairs if not any(part in pair[0] for part in parts)]


def test_a_client_without_a_certificate_is_refused(router: Router) -> None:
    """Though it trusts the right authority and knows the user name of the certified."""
    link = router.link("agent-3")
    with pytest.raises(zenoh.ZError):
        opened(link, without(client_pairs(link), "connect_certificate", "connect_private_key", "enable_mtls"))


def test_a_client_with_a_password_alone_is_refused_over_tls(router: Router) -> None:
    pairs = without(client_pairs(router.link("agent-3")), "connect_certificate", "connect_private_key", "mtls", USER)
    with pytest.raises(zenoh.ZError):
        opened(router.link("agent-3"), [*without(pairs, PASSWORD), (USER, "agent-3"), (PASSWORD, "secret 3")])


def test_a_certificate_of_another_authority_is_refused(router: Router, tmp_path: Path) -> None:
    """Though it carries the right name and the client trusts the world."""
    certificates.make(tmp_path, [3], [], 1)
    stranger = replace(tls_files(tmp_path, "agent-3"), ca=tls_files(router.folder, "ca").ca)
    with pytest.raises(zenoh.ZError):
        opened(RouterLink(router.tls, tls=stranger))


def test_an_expired_certificate_is_refused(router: Router) -> None:
    """Expired an hour ago; one that expires in an hour comes in."""
    with pytest.raises(zenoh.ZError):
        opened(router.sign("expired", "agent-3", days=-1 / 24))
    opened(router.sign("current", "agent-3", days=1 / 24)).close()


def test_a_link_ends_when_its_certificate_does(router: Router) -> None:
    with opened(router.sign("brief", "agent-3", days=15 / 86_400)) as session:
        assert session.info.routers_zid()
        wait_until(lambda: not session.info.routers_zid(), "the end of the certificate")


def test_the_client_refuses_a_world_of_another_authority(router: Router, tmp_path: Path) -> None:
    certificates.make(tmp_path, [], [], 1)
    with pytest.raises(zenoh.ZError):
        opened(RouterLink(router.tls, tls=replace(tls_files(router.folder, "agent-3"), ca=str(tmp_path / "ca.pem"))))


def test_the_client_refuses_another_agent_as_world(router: Router) -> None:
    """A board that listens with its own certificate is not taken for the world: its name does not fit."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    link = RouterLink(endpoint, tls=tls_files(router.folder, "agent-4"))
    pairs = router_pairs(link, str(router.folder / "credentials"), KEYS, ())
    with zenoh.open(configured(zenoh.Config, pairs, link)), pytest.raises(zenoh.ZError):
        opened(replace(router.link("agent-3"), endpoint=endpoint))


def as_three(router: Router) -> dict[str, tuple[RouterLink, Pairs]]:
    """Ways to come with agent 3's certificate, some of them with agent 4's good name and password."""
    link = router.link("agent-3")
    plain = client_pairs(link)
    return {
        "the certificate": (link, plain),
        "with agent 4's password": (link, [*without(plain, USER, PASSWORD), (USER, "agent-4"), (PASSWORD, "secret 4")]),
    }


@pytest.mark.parametrize("way", ["the certificate", "with agent 4's password"])
def test_agent_3s_certificate_speaks_as_agent_3_alone(router: Router, way: str) -> None:
    """What it sends on agent 4's keys reaches nobody; its own act, sent behind, is the first thing heard."""
    with opened(*as_three(router)[way]) as session:
        mark = session.declare_publisher(KEYS.agent(3, ACT), congestion_control=zenoh.CongestionControl.BLOCK)
        for leaf in (ACT, RADIO, REPORT, FRAME):
            session.put(KEYS.agent(4, leaf), b"forged", congestion_control=zenoh.CongestionControl.BLOCK)
        wait_until(lambda: mark.matching_status.matching, "a way to the world")
        mark.put(b"mark")
        wait_until(lambda: router.heard, "the mark")
    assert router.heard == [(KEYS.agent(3, ACT), b"mark")]


@pytest.mark.parametrize("way", ["the certificate", "with agent 4's password"])
def test_agent_3s_certificate_hears_agent_3s_frames_alone(router: Router, way: str) -> None:
    with opened(*as_three(router)[way]) as session:
        heard: list[str] = []
        subscribers = [
            session.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr)))
            for key in (KEYS.agent(4, FRAME), KEYS.agent("*", FRAME), f"{KEYS.root}/**", KEYS.agent(3, FRAME))
        ]
        frame = router.session.declare_publisher(KEYS.agent(3, FRAME), allowed_destination=zenoh.Locality.REMOTE)
        wait_until(lambda: frame.matching_status.matching, "the agent's subscription")
        router.session.put(KEYS.agent(4, FRAME), b"4", allowed_destination=zenoh.Locality.REMOTE)
        frame.put(b"3")
        wait_until(lambda: heard, "its own frame")
        frame.undeclare()
        assert set(heard) == {KEYS.agent(3, FRAME)}
        assert len(subscribers) == 4


@pytest.mark.parametrize(
    ("user", "password", "keys"),
    [("agent-3", "secret 3", [KEYS.agent(3, ACT)]), (CERTIFIED, CERTIFIED, [])],
    ids=["a password", "the certified's"],
)
def test_over_tcp_a_password_counts_and_the_certifieds_name_opens_nothing(
    router: Router, user: str, password: str, keys: list[str]
) -> None:
    """Everything that a session sent has been seen once the router has seen its end."""
    with opened(RouterLink(router.tcp, user, password)) as session:
        own = str(session.zid())
        wait_until(lambda: own in _clients(router), "the client")
        for agent in AGENTS:
            session.put(KEYS.agent(agent, ACT), b"tcp", congestion_control=zenoh.CongestionControl.BLOCK)
    wait_until(lambda: own not in _clients(router), "the client's end")
    assert [key for key, _ in router.heard] == keys


def _clients(router: Router) -> set[str]:
    return {str(transport.zid) for transport in router.session.info.transports()}


@pytest.mark.processes
def test_an_agent_over_tls_takes_part_in_a_run(tmp_path: Path) -> None:
    """Five agents over loopback with passwords, one over TLS with its certificate; the digest is the usual one."""
    outcome = run_with_board(tmp_path, [sys.executable, "-P", "-m", "deltaswarm_agent"], {})
    assert outcome.is_complete
    assert outcome.digest == usual_digest(tmp_path)


@pytest.mark.parametrize(
    ("endpoints", "change", "message"),
    [
        (["tls/127.0.0.1:0"], {"key": None}, "tls/127.0.0.1:0 .*missing: key"),
        (["tls/127.0.0.1:0"], {"ca": "/nowhere/ca.pem"}, "ca: .*No such file.*: '/nowhere/ca.pem'"),
        (["tcp/127.0.0.1:0"], {}, "ca, certificate, key must .*tls/"),
    ],
)
def test_certificates_are_asked_for_where_they_are_needed(
    made: Router, endpoints: list[str], change: dict[str, str | None], message: str
) -> None:
    files: dict[str, str | None] = {**vars(tls_files(made.folder, "agent-3")), **change}
    with pytest.raises(ValueError, match=message):
        tls_of(endpoints, **files)


def test_the_world_listens_on_the_network_over_tls_alone(made: Router, tmp_path: Path, capsys: Printed) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(to_toml(load_scenario("smoke", [])))
    arguments = ["--scenario", str(scenario), "--run", "x", "--credentials", str(tmp_path / "credentials")]
    arguments += ["--out", str(tmp_path / "out"), "--listen", "tls/0.0.0.0:0", "--listen", "tcp/0.0.0.0:0"]
    assert world_main([*arguments, *tls_arguments(made.folder, "world")]) == 2
    assert re.search(r"--listen .*loopback.*tcp/0\.0\.0\.0:0", capsys.readouterr().err)


def test_the_certified_are_admitted_once(tmp_path: Path) -> None:
    """Their line is added to the credentials, behind the last, once, and the mode stays."""
    file = tmp_path / "credentials"
    file.touch(mode=0o600)
    file.write_text("agent-3:x")
    for _ in range(2):
        admit_certified(["tls/0.0.0.0:1", "tcp/127.0.0.1:1", "tcp/[::1]:1"], file)
    assert file.read_text() == f"agent-3:x\n{CERTIFIED}:{CERTIFIED}\n"
    assert file.stat().st_mode & 0o777 == 0o600


@dataclass
class Revoking:
    """A router that was opened after agent 3's certificate was revoked."""

    folder: Path
    stolen: RouterLink
    renewed: RouterLink
    heard: list[tuple[str, bytes]]


@pytest.fixture
def revoking(tmp_path: Path) -> Iterator[Revoking]:
    folder = tmp_path / "certificates"
    certificates.make(folder, AGENTS, [], 1)
    for ending in ("pem", "key"):
        (folder / f"stolen.{ending}").write_bytes((folder / f"agent-3.{ending}").read_bytes())
    (folder / "stolen.key").chmod(0o600)
    certificates.revoke(folder, ["agent-3"])
    certificates.make(folder, [3], [], 1)
    credentials = folder / "credentials"
    credentials.touch()
    endpoints = [f"tls/127.0.0.1:{free_port()}"]
    admit_certified(endpoints, credentials)
    link = RouterLink(endpoints[0], tls=tls_files(folder, "world"))
    heard: list[tuple[str, bytes]] = []
    with zenoh.open(
        configured(zenoh.Config, router_pairs(link, str(credentials), KEYS, AGENTS, endpoints), link)
    ) as at:
        at.declare_subscriber(
            KEYS.from_agents,
            zenoh.handlers.Callback(
                lambda sample: heard.append((str(sample.key_expr), sample.payload.to_bytes())), indirect=False
            ),
        )
        stolen, renewed = (RouterLink(endpoints[0], tls=tls_files(folder, name)) for name in ("stolen", "agent-3"))
        yield Revoking(folder, stolen, renewed, heard)


def test_a_revoked_certificate_speaks_as_nobody_and_its_successor_as_the_agent(revoking: Revoking) -> None:
    """What the old one sends is dropped, though it carries the authority's signature."""
    key = KEYS.agent(3, RADIO)
    with opened(revoking.stolen) as stolen, opened(revoking.renewed) as renewed:
        stolen.put(key, b"stolen")
        publisher = renewed.declare_publisher(key)
        wait_until(lambda: publisher.matching_status.matching, "the router's subscription")
        publisher.put(b"renewed")
        wait_until(lambda: bool(revoking.heard), "the renewed board")
        stolen.put(key, b"stolen")
        publisher.put(b"again")
        wait_until(lambda: len(revoking.heard) >= 2, "both of its frames")
    assert revoking.heard == [(key, b"renewed"), (key, b"again")]


def test_a_board_with_a_revoked_certificate_is_told(revoking: Revoking) -> None:
    """Before it meets silence; the new one is well, and so is another agent's."""
    assert "revoked" in certificate_problem(tls_files(revoking.folder, "stolen"), "agent-3")
    assert certificate_problem(tls_files(revoking.folder, "agent-3"), "agent-3") == ""
    assert certificate_problem(tls_files(revoking.folder, "agent-4"), "agent-4") == ""


def test_certificates_are_revoked_one_after_the_other(tmp_path: Path, capsys: Printed) -> None:
    """By the command: each time the list grows by the present name, and the agent has a new certificate."""
    folder = tmp_path / "certificates"
    assert main(["certificates", "--out", str(folder), "--agents", "3-4"]) == 0
    other = (folder / "agent-4.pem").read_bytes()
    for names in (["agent-3"], ["agent-3", "agent-3.2"]):
        assert main(["certificates", "--out", str(folder), "--revoke", "agent-3"]) == 0
        assert (folder / "revoked.txt").read_text().split() == names
        assert certificate_problem(tls_files(folder, "agent-3"), "agent-3") == ""
    assert (folder / "agent-4.pem").read_bytes() == other
    capsys.readouterr()
    for name in ("agent-9", "world", "nobody", "ca", "agent-03x", "agent-3.2"):
        assert main(["certificates", "--out", str(folder), "--revoke", name]) == 2
        assert name in capsys.readouterr().err
    assert (folder / "revoked.txt").read_text().split() == ["agent-3", "agent-3.2"]


@pytest.mark.parametrize("count", [1, 5, 25])
def test_rules_name_the_certificates_that_count(count: int) -> None:
    revoked = {"agent-0", "agent-0.2", OPERATOR}
    rules = (air_rules(KEYS, range(count), revoked), world_rules(KEYS, range(count), (), revoked))
    for rule in rules:
        names = {name for subject in rule["subjects"] for name in subject["cert_common_names"]}
        assert not names & revoked
        assert {"agent-0.3", f"{OPERATOR}.2", *(f"agent-{agent}" for agent in range(1, count))} <= names
