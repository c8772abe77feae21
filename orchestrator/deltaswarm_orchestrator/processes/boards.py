"""Hardware in the loop: write the files of a run's boards into one folder, and say how to start the boards."""

import ipaddress
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.access import REVOKED, TLS, user_name
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.files import write_whole
from deltaswarm_wire.keys import AGENT, WORLD
from deltaswarm_wire.session import WITH_PORT, Tls, endpoint_problem, host_and_port, protocol_of

CERTIFICATE_DAYS = 365


@dataclass(frozen=True)
class Boards:
    """Agents of a run that are started elsewhere: their numbers, the world's address, and their folder.

    The folder holds what is copied to boards. The authority's key and the world's certificate are kept in a separate
    folder beside it (`authority_folder`).
    """

    agents: tuple[int, ...]
    listen: str
    folder: Path

    def check(self, scenario: Scenario) -> None:
        """Check that a scenario can be run with these boards."""
        problems = []
        if self.agents[-1] >= scenario.agents.count:
            allowed = f"must be 0 to {scenario.agents.count - 1} (agents.count)"
            problems.append(Problem("--boards", str(self.agents[-1]), allowed))
        if problem := endpoint_problem(self.listen, connects=True):
            problems.append(Problem("--listen", repr(self.listen), problem))
        elif protocol_of(self.listen) not in WITH_PORT or is_any(self._host):
            allowed = "must be this machine's address, to which boards connect"
            problems.append(Problem("--listen", repr(self.listen), allowed))
        problems += signal_problems(scenario, "some of which are on boards")
        if problems:
            raise SettingsError(problems)
        check_out(self.folder, "--boards-folder")

    def prepare(self, scenario: Scenario) -> None:
        """Make the folder and, if the world is reached over TLS, missing certificates."""
        self.check(scenario)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if self._is_over_tls:
                self._make_certificates()
        except ValueError as error:
            raise SettingsError([Problem("--boards-folder", str(self.folder), str(error))]) from None

    def _make_certificates(self) -> None:
        from deltaswarm_orchestrator.processes import certificates  # only TLS needs cryptography

        authority = authority_folder(self.folder)
        authority.mkdir(mode=0o700, exist_ok=True)
        authority.chmod(0o700)
        if (self.folder / "ca.key").exists():  # an authority made by hand in the boards' folder
            for file in (*self.folder.glob("*.pem"), *self.folder.glob("*.key"), *self.folder.glob(REVOKED)):
                file.replace(authority / file.name)
        for ending in ("pem", "key"):  # made again, for the current address
            (authority / f"{WORLD}.{ending}").unlink(missing_ok=True)
        certificates.make(authority, self.agents, [self._host], CERTIFICATE_DAYS)
        revoked = [REVOKED] if (authority / REVOKED).exists() else []
        for name in ("ca.pem", *revoked, *(f"{user_name(AGENT, agent)}.pem" for agent in self.agents)):
            write_whole(self.folder / name, (authority / name).read_bytes())
        for name in (f"{user_name(AGENT, agent)}.key" for agent in self.agents):
            write_whole(self.folder / name, (authority / name).read_bytes(), 0o600)

    @property
    def tls(self) -> Tls | None:
        folder = authority_folder(self.folder)
        files = [str(folder / name) for name in ("ca.pem", f"{WORLD}.pem", f"{WORLD}.key")]
        return Tls(*files) if self._is_over_tls else None

    @property
    def _is_over_tls(self) -> bool:
        return protocol_of(self.listen) == TLS

    @property
    def _host(self) -> str:
        return host_and_port(self.listen)[0]

    def write(self, run: str, endpoint: str, scenario: Scenario, password: Callable[[str], str]) -> list[Path]:
        """Write each board's settings and, without TLS, its password; return the files of the settings."""
        files = []
        for agent in self.agents:
            name = user_name(AGENT, agent)
            air: dict[str, object] = {"mode": "client", "connect": [endpoint]}
            if self._is_over_tls:
                air["tls"] = {"ca_file": "ca.pem", "cert_file": f"{name}.pem", "key_file": f"{name}.key"}
            else:
                air["credentials_file"] = f"{name}.password"
                write_whole(self.folder / f"{name}.password", f"{name}:{password(name)}\n".encode(), 0o600)
            settings = checked.plain(scenario.for_agent(agent))
            table = {"id": agent, "run": run, "air": air, "body": {"kind": "world"}, "agent": settings}
            files.append(self.folder / f"{agent}.toml")
            write_whole(files[-1], tomli_w.dumps(table).encode())
        return files


def authority_folder(boards: Path) -> Path:
    """Return the folder of keys that no board gets; it lies beside the boards' folder, so it is not copied with it.

    Raises:
        ValueError: the boards' folder is the root of the file system.
    """
    folder = boards.resolve()
    return folder.with_name(f"{folder.name}.authority")


def signal_problems(scenario: Scenario, why: str) -> list[Problem]:
    """Return a problem for each fault, or crash, that signals processes of agents; `why` that is not possible."""
    dynamics = scenario.world.dynamics
    crash = Problem("world.dynamics", repr(dynamics), f"must not end processes by crashes, {why}")
    return [crash] * scenario.world.to_process + [
        Problem(f"fault.{number}.kind", repr(fault.kind), f"must not signal processes, {why}")
        for number, fault in enumerate(scenario.fault)
        if fault.to_process
    ]


def is_any(host: str) -> bool:
    """Whether a host stands for all addresses of this machine, to which no other machine can connect."""
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return not host


def commands(files: Sequence[Path]) -> str:
    lines = [f"    deltaswarm-agent board {file.name}" for file in files]
    where = files[0].parent
    if (authority := authority_folder(where)).exists():
        lines.append(f"the authority's private key stays on this machine: {authority / 'ca.key'}")
    return "\n".join([f"waits for {len(files)} boards; on each, with its files of {where} beside it:", *lines])
