"""The settings file of a board."""

import os
from argparse import ArgumentTypeError
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltaswarm_wire import checked
from deltaswarm_wire.access import REVOKED, TLS, air_rules, revoked_beside, user_name
from deltaswarm_wire.arguments import agent_numbers, password_in
from deltaswarm_wire.checked import Problem, SettingsError, key
from deltaswarm_wire.commands import BASE_ID
from deltaswarm_wire.keys import AGENT, RUN_NAME_RULE, Keys
from deltaswarm_wire.plugins import controller_settings
from deltaswarm_wire.reading import decoded, parsed_toml
from deltaswarm_wire.session import QUIC, Pairs, RouterLink, Tls, air_pairs, link_problems, protocol_of, tls_pairs
from deltaswarm_wire.settings import AgentSettings, ControlSettings
from deltaswarm_wire.signing import PUBLIC_KEY_RULE, is_public_key

MODES = ("peer", "client")
RECORDS = ("off", "mcap")
KINEMATIC = "kinematic"
MAX_FILE_BYTES = 1_000_000
WORLD_BODY = "world"
"""A body simulated by the world, which also provides air and clock."""


@dataclass(frozen=True)
class TlsSettings:
    """Certificates for `tls/` and `quic/` endpoints; both ends present one (mTLS)."""

    ca_file: str = key("", "trusted certificate authority (PEM)")
    cert_file: str = key("", "this board's certificate (PEM)")
    key_file: str = key("", "its private key (PEM), readable by its owner only")
    verify_name: bool = key(True, "check the other end's name against its certificate")

    def problems(self) -> list[Problem]:
        """Check that all three files or none are given, each readable, the key only by its owner."""
        files = {name: getattr(self, name) for name in ("ca_file", "cert_file", "key_file")}
        if not any(files.values()):
            return []
        problems = [_readable(name, file, secret=name == "key_file") for name, file in files.items()]
        return [problem for problem in problems if problem]

    @property
    def files(self) -> Tls | None:
        return Tls(self.ca_file, self.cert_file, self.key_file) if self.ca_file else None

    def pairs(self) -> Pairs:
        pairs = tls_pairs(self.files, "connect", "listen")
        return [*pairs, ("transport/link/tls/verify_name_on_connect", self.verify_name)] if pairs else []


@dataclass(frozen=True)
class AirSettings:
    """How the board reaches its neighbours and the operator."""

    mode: str = key("peer", "a peer among boards, or a client of a router", choices=MODES)
    connect: tuple[str, ...] = key((), "endpoints to connect to, retried without end, such as tcp/192.168.1.10:7447")
    listen: tuple[str, ...] = key((), "peer: endpoints to listen on, such as tcp/0.0.0.0:7447")
    multicast: bool = key(False, "peer: find others on the local network by multicast; listens on any port")
    gossip: bool = key(False, "peer: connect to the peers of one's peers as well")
    range_m: float = key(
        0.0, "drop frames from senders farther away by their own account [m]; 0: the radio decides", low=0
    )
    stale_s: float = key(3.0, "drop frames delayed by this much more than usual [s]", above=0, high=3600)
    agents: str = key("", "admitted agents, such as 0-24, identified by certificate; empty: any agent")
    operator_key: str = key(
        "", "public key of the operator, whose commands are obeyed; empty: every command is refused"
    )
    has_clock: bool = key(
        True,
        "the board's clock is right within 2 min, and commands that are not of now are refused; false: the first "
        "command after a start is obeyed, however old",
    )
    credentials_file: str = key("", "`user:password` lines, readable by its owner only; the agent uses its own line")
    tls: TlsSettings = key(TlsSettings, "certificates")
    zenoh: dict[str, Any] = key(dict, "any other Zenoh setting, by its path: its value as JSON5 text")

    def problems(self) -> list[Problem]:
        problems = []
        if self.mode == "client" and not self.connect:
            problems.append(Problem("connect", "none", "must name the router of a client"))
        if self.mode == "client" and self.listen:
            problems.append(Problem("listen", ", ".join(self.listen), "must be left out for a client"))
        if self.mode == "peer" and not (self.connect or self.listen or self.multicast):
            problems.append(Problem("connect", "none", "must be given for a peer, or else listen or multicast"))
        problems += link_problems(self.connect, self.listen, self.zenoh)
        for name in ("connect", "listen"):
            for endpoint in getattr(self, name):
                if protocol_of(endpoint) in (TLS, QUIC) and not self.tls.ca_file:
                    problems.append(Problem(name, repr(endpoint), "must have its certificates in air.tls"))
        problems += self._unknown_agents()
        if self.operator_key and not is_public_key(self.operator_key):
            problems.append(Problem("operator_key", repr(self.operator_key), PUBLIC_KEY_RULE))
        if self.credentials_file:
            problem = _readable("credentials_file", self.credentials_file, secret=True)
            problems += [problem] if problem else []
        return problems

    def _unknown_agents(self) -> list[Problem]:
        if not self.agents:
            return []
        if not self.tls.ca_file or any(protocol_of(endpoint) != TLS for endpoint in (*self.connect, *self.listen)):
            return [
                Problem(
                    "agents",
                    repr(self.agents),
                    "must be left out unless every endpoint is tls/: certificates name the agents",
                )
            ]
        try:
            agent_numbers(self.agents)
        except ArgumentTypeError as error:
            return [Problem("agents", repr(self.agents), str(error).partition(" (got")[0])]
        return []

    @property
    def numbers(self) -> list[int]:
        """The admitted agents; empty: any agent."""
        return agent_numbers(self.agents) if self.agents else []

    def link(self, user: str) -> RouterLink:
        """Return the first endpoint with credentials and the user's own Zenoh settings. Raises as `password_in`."""
        password = password_in(Path(self.credentials_file), user) if self.credentials_file else ""
        endpoint = self.connect[0] if self.connect else ""
        tls = self.tls.files if protocol_of(endpoint) == TLS else None
        return RouterLink(endpoint, user if password else "", password, False, tuple(self.zenoh.items()), tls)

    def pairs(self, user: str) -> Pairs:
        link = self.link(user)
        listen = self.listen
        if self.mode == "peer" and self.multicast and not listen:
            listen = (f"{TLS if self.tls.ca_file else 'tcp'}/0.0.0.0:0",)  # discovered peers must be able to connect
        pairs: Pairs = [
            *air_pairs(self.mode, self.connect, listen, multicast=self.multicast, gossip=self.gossip),
            *self.tls.pairs(),
        ]
        if self.tls.ca_file:  # discovered peers also have certificates, or use a given endpoint
            pairs.append(("transport/link/protocols", sorted({TLS, *map(protocol_of, (*self.connect, *listen))})))
        if link.user:
            pairs += [("transport/auth/usrpwd/user", link.user), ("transport/auth/usrpwd/password", link.password)]
            if self.mode == "peer":
                pairs.append(("transport/auth/usrpwd/dictionary_file", self.credentials_file))
        return pairs


@dataclass(frozen=True)
class BodyChoice:
    """The body, and the required quality of its position."""

    kind: str = key(KINEMATIC, "world, kinematic, mavlink, ros2, another by entry point, or module:Class")
    arrive_m: float = key(0.2, "tolerance for arriving at a target [m]", low=0, high=10)
    max_std_m: float = key(5.0, "largest standard deviation of a usable position [m]", above=0)
    follower: str = key("", "world: a body whose robot follows the simulated one, such as ros2; empty: none")
    options: dict[str, Any] = key(dict, "the body's own options, or its follower's")


@dataclass(frozen=True)
class LogSettings:
    """Logs and recordings on the board, each at most (1 + backups) * max_bytes."""

    folder: str = key("", "folder; empty: standard error only")
    max_bytes: int = key(1_000_000, "length at which a new file begins", low=10_000, high=10_000_000_000)
    backups: int = key(3, "number of older files to keep", low=1, high=1000)
    level: str = key("INFO", "least grave line", choices=("DEBUG", "INFO", "WARNING", "ERROR"))
    every_s: float = key(60.0, "a line of counts this often [s]", above=0)
    record: str = key("off", "mcap: the agent's own frames and what it hears, beside the log", choices=RECORDS)

    def problems(self) -> list[Problem]:
        """Check that a recording has a folder, and that the folder's name is valid."""
        if "\0" in self.folder:
            return [Problem("folder", repr(self.folder), "must have no NUL character")]
        if self.record != "off" and not self.folder:
            return [Problem("record", repr(self.record), "must be off without log.folder")]
        return []


@dataclass(frozen=True)
class BoardSettings:
    """One agent on one board."""

    id: int = key(0, "the agent's number", low=0, high=BASE_ID - 1)
    run: str = key("field", "name of the run, shared by all its parts")
    agent: AgentSettings = key(AgentSettings, "its task, as the world writes it into agent.toml")
    air: AirSettings = key(AirSettings, "link to neighbours and operator")
    body: BodyChoice = key(BodyChoice, "its robot")
    log: LogSettings = key(LogSettings, "its logs and recordings")

    def problems(self) -> list[Problem]:
        problems = []
        try:
            Keys(self.run)
        except ValueError:
            problems.append(Problem("run", repr(self.run[:80]), RUN_NAME_RULE))
        if self.air.credentials_file:
            try:
                password_in(Path(self.air.credentials_file), self.user)
            except ValueError as error:
                problems.append(Problem("air.credentials_file", repr(self.air.credentials_file), str(error)))
        if self.body.kind == WORLD_BODY:
            problems += self._not_of_a_world()
        elif self.body.follower:
            problems.append(Problem("body.follower", repr(self.body.follower), "must be left out without a world"))
        elif self.air.agents and self.id not in self.air.numbers:
            problems.append(Problem("air.agents", repr(self.air.agents), f"must include this agent, {self.id}"))
        ca = self.air.tls.ca_file
        revoked: Collection[str] = ()
        try:
            revoked = revoked_beside(ca) if ca else ()
        except ValueError as error:
            problems.append(Problem("air.tls.ca_file", repr(ca), f"must have a readable list beside it: {error}"))
        if revoked and not self.air.agents and self.body.kind != WORLD_BODY:
            allowed = f"must name the admitted agents, since there is a {REVOKED} beside air.tls.ca_file"
            problems.append(Problem("air.agents", "none", allowed))
        return problems

    def _not_of_a_world(self) -> list[Problem]:
        """Check what a body simulated by the world excludes."""
        problems = []
        if len(self.air.connect) != 1:
            problems.append(Problem("air.connect", f"{len(self.air.connect)}", "must have one endpoint, the world's"))
        if any(protocol_of(endpoint) == QUIC for endpoint in self.air.connect):
            problems.append(Problem("air.connect", self.air.connect[0], "must be tls/ or tcp/, as the world's"))
        if not self.air.tls.verify_name:
            problems.append(
                Problem("air.tls.verify_name", "false", "must be true: the world's certificate names its addresses")
            )
        if self.air.agents:
            problems.append(
                Problem("air.agents", repr(self.air.agents), "must be left out: the world admits its agents")
            )
        if self.air.operator_key:
            problems.append(Problem("air.operator_key", repr(self.air.operator_key), "must be left out with a world"))
        if self.log.record != "off":
            problems.append(
                Problem("log.record", repr(self.log.record), "must be off: the world's recorder has the frames")
            )
        return problems

    @property
    def user(self) -> str:
        return user_name(AGENT, self.id)

    @property
    def pairs(self) -> Pairs:
        """Zenoh's settings for open air, with access rules."""
        pairs = self.air.pairs(self.user)
        if self.air.agents:
            revoked = revoked_beside(self.air.tls.ca_file)
            pairs.append(("access_control", air_rules(Keys(self.run), self.air.numbers, revoked)))
        return pairs


def read_settings(file: Path) -> BoardSettings:
    """Read and check a board's settings file. Paths in it are relative to its folder.

    The file names code that the agent runs, so a file that everybody may write to is refused.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is too large, writable by everybody or no TOML, or (SettingsError) has mistakes.
    """
    with file.open("rb") as stream:
        mode = os.fstat(stream.fileno()).st_mode & 0o777
        data = stream.read(MAX_FILE_BYTES + 1)
    if mode & 0o002:
        raise ValueError(
            f"must be writable by its owner only, not mode {mode:04o}, for it names code to run: chmod 644 {file}"
        )
    if len(data) > MAX_FILE_BYTES:
        raise ValueError(f"must be at most {MAX_FILE_BYTES} bytes")
    try:
        return _checked(file, parsed_toml(decoded(data)))
    except RecursionError:  # while mistakes are shown
        raise ValueError("must not be nested so deeply") from None


def _checked(file: Path, table: dict[str, Any]) -> BoardSettings:
    air = table.get("air")
    if type(air) is dict:
        _find_beside(file.parent, air, "credentials_file")
        if type(air.get("tls")) is dict:
            for name in ("ca_file", "cert_file", "key_file"):
                _find_beside(file.parent, air["tls"], name)
    body = table.get("body")
    if type(body) is dict and str(body.get("kind", KINEMATIC)) == KINEMATIC and type(body.get("options")) is dict:
        _find_beside(file.parent, body["options"], "events")
    settings, problems = checked.check(BoardSettings, table)
    problems += _control_problems(table)
    if settings is None or problems:
        raise SettingsError(problems)
    return settings


def _control_problems(table: dict[str, Any]) -> list[Problem]:
    """Check the controller's options, even if other settings are wrong."""
    agent = table.get("agent", {})
    known, _ = checked.known(AgentSettings, agent)
    control, _ = checked.check(ControlSettings, agent.get("control", {}) if type(agent) is dict else {})
    if control is None:
        return []  # reported with the other keys
    try:
        controller_settings(control.mode, control.options, known or AgentSettings(), "agent.control")
    except SettingsError as error:
        return error.problems
    return []


def _find_beside(folder: Path, table: dict[str, Any], name: str) -> None:
    """Resolve a relative path against the folder of the settings file."""
    value = table.get(name)
    if type(value) is str and value:
        table[name] = str(folder.absolute() / value)


def _readable(name: str, file: str, *, secret: bool = False) -> Problem | None:
    """Check that a file is readable and, if `secret`, private."""
    path = Path(file)
    if not os.path.isfile(file):  # unlike Path's, it takes any text
        return Problem(name, repr(file), "must be a file that exists")
    mode = path.stat().st_mode & 0o777
    if secret and mode & 0o077:
        return Problem(name, f"{file!r} of mode {mode:04o}", f"must be a file of mode 0600: chmod 600 {file}")
    try:
        with path.open("rb") as stream:
            stream.read(1)
    except OSError as error:
        return Problem(name, repr(file), f"must be readable: {error}")
    return None
