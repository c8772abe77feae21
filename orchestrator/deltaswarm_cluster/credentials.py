"""The certificates of one run over many machines, which are made for it and are worth nothing after it.

The authority's key is never written. World and agents trust this authority alone.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from deltaswarm_orchestrator.processes.certificates import LOCAL_HOSTS, Authority, check_host, pem_of
from deltaswarm_wire.access import user_name
from deltaswarm_wire.files import write_secret
from deltaswarm_wire.keys import AGENT, WORLD
from deltaswarm_wire.session import Tls

DAYS = 365
"""The links are cut when certificates expire, so they outlast any run."""


@dataclass(frozen=True, repr=False)
class Credentials:
    """The authority of one run."""

    authority: Authority
    host: str
    """The name or address by which agents know the world's machine."""

    @classmethod
    def create(cls, host: str) -> "Credentials":
        """Create the authority of a run.

        Raises:
            ValueError: the host is not a name or address.
        """
        check_host(host)
        return cls(Authority.create(DAYS), host)

    @property
    def ca(self) -> bytes:
        """The authority's certificate (PEM)."""
        return pem_of(self.authority.key, self.authority.certificate)[1]

    def of_agents(self, agents: Iterable[int]) -> dict[int, tuple[bytes, bytes]]:
        """Make private key and certificate (PEM) of each agent."""
        return {agent: pem_of(*self.authority.sign(user_name(AGENT, agent), DAYS)) for agent in agents}

    def write_worlds(self, folder: Path) -> Tls:
        """Write the world's files into a private folder, from which they can go once the router has read them.

        Raises:
            OSError: the folder cannot be written.
        """
        hosts = tuple(dict.fromkeys((*LOCAL_HOSTS, self.host)))
        key, certificate = pem_of(*self.authority.sign(WORLD, DAYS, hosts))
        ca = folder / "ca.pem"
        files = {ca: self.ca, folder / f"{WORLD}.pem": certificate, folder / f"{WORLD}.key": key}
        for file, content in files.items():
            write_secret(file, content)
        return Tls(*map(str, files))
