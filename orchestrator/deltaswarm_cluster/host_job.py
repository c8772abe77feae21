"""What passes between the orchestrator and a host of agents. Both ends run the same version of this file."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class AgentFiles:
    """The files of one agent, in memory."""

    settings: str
    """Its settings (TOML)."""
    certificate: bytes = field(repr=False)
    key: bytes = field(repr=False)
    """Its private key (PEM). It is in no representation, since Dask logs the arguments of tasks that fail."""


@dataclass(frozen=True)
class HostJob:
    """What one host of agents is to do."""

    run: str
    """The run's name on the network."""
    connect: str
    """The world's endpoint."""
    mode: str
    """The scenario's controller, which is loaded once for all agents if it is shipped."""
    start_timeout_s: float
    authority: bytes = field(repr=False)
    """Certificate of the authority (PEM)."""
    agents: dict[int, AgentFiles] = field(repr=False)
    zenoh: tuple[str, ...] = ()
    """The user's own Zenoh settings, as KEY=VALUE."""


@dataclass
class News:
    """What has happened at a host since the last news."""

    logs: dict[int, bytes] = field(default_factory=dict)
    """New bytes of the agents' logs."""
    ended: dict[int, int] = field(default_factory=dict)
    """Exit codes of agents that have ended."""
    failed: str = ""
    """Why the host gave up, empty if it did not."""
    is_over: bool = False
    """Whether all its agents have ended and nothing more will come."""


class HostLostError(Exception):
    """A host no longer answers; the text says why, if that is known."""
