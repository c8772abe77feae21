"""Measure the floor of a run's own traffic: the same samples between the same sessions, and nothing computed.

`traffic.py` records the traffic. This file imports little, because every process of the floor pays for it.
"""

import queue
import secrets
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.bench.floors import QUEUE_SAMPLES, children
from deltaswarm_orchestrator.processes.entry_point import run_in_background
from deltaswarm_orchestrator.processes.starter import room_for
from deltaswarm_wire.access import user_name
from deltaswarm_wire.keys import ACT, AGENT, FRAME, OPERATOR, RADIO, REPORT, TAKEN, WORLD, Keys
from deltaswarm_wire.session import RouterLink, client_pairs, configured, free_port, router_pairs, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

KEYS = Keys("floor")
CONTENT = b"x" * 65536
"""More than any sample has."""

READY_WITHIN_S = 300.0
POLL_S = 0.01


class SentSample(NamedTuple):
    """One sample of an agent."""

    leaf: str
    payload_bytes: int
    attached_bytes: int | None = None
    """Size of the attached act [bytes]; None: no act is attached."""


Answer = tuple[SentSample, ...]
"""An agent's samples in answer to one frame, in the order in which it sends them."""


class StepTraffic(NamedTuple):
    """One step: what the world sends to whom, and what it waits for."""

    frames: tuple[tuple[int, int], ...]
    """(agent, size [bytes]) of each frame."""
    answers: int
    """Number of samples that the agents send."""
    reports: tuple[int, ...]
    """Size of each report forwarded to the operator [bytes]."""
    clock_bytes: int


@dataclass(frozen=True)
class Traffic:
    """A run's traffic."""

    agents: int
    steps: Sequence[StepTraffic]
    answers: Sequence[Sequence[Answer]]
    """By agent, its answers to its frames in order."""


def own_traffic_steps_per_s(traffic: Traffic) -> float:
    """Measure what Zenoh allows for this traffic: a router here, a client process per agent, and an operator's.

    Sessions, access rules, publishers, subscribers and scheduling are those of a run.
    """
    users = [*(user_name(AGENT, agent) for agent in range(traffic.agents)), OPERATOR]
    passwords = {user: secrets.token_urlsafe(24) for user in users}
    endpoint, overrides = f"tcp/127.0.0.1:{free_port()}", tuple(room_for(traffic.agents))
    links = [RouterLink(endpoint, user, passwords[user], low_latency=True, overrides=overrides) for user in users]
    with TemporaryFolder() as folder:
        credentials = folder / "credentials"
        credentials.write_text("".join(f"{user}:{word}\n" for user, word in passwords.items()), encoding="ascii")
        router = RouterLink(endpoint, overrides=overrides)
        pairs = router_pairs(router, str(credentials), KEYS, range(traffic.agents))
        with zenoh.open(configured(zenoh.Config, pairs, router)) as session:
            return _replay(session, traffic, links)


def _replay(session: zenoh.Session, traffic: Traffic, links: Sequence[RouterLink]) -> float:
    answers = session.declare_subscriber(KEYS.from_agents, zenoh.handlers.FifoChannel(8 * traffic.agents + 64))
    remote = zenoh.Locality.REMOTE
    frames = [_publisher(session, KEYS.agent(agent, FRAME), remote) for agent in range(traffic.agents)]
    forwarded, clock = (_publisher(session, key, remote) for key in (KEYS.forwarded, KEYS.clock))
    token = session.liveliness().declare_token(KEYS.token(WORLD))
    ready: queue.SimpleQueue[object] = queue.SimpleQueue()
    watch = session.liveliness().declare_subscriber(KEYS.all_tokens, ready.put)
    *to_agents, to_operator = links
    scripts = [
        (agent, script, link) for agent, (script, link) in enumerate(zip(traffic.answers, to_agents, strict=True))
    ]
    forwards = sum(len(step.reports) + 1 for step in traffic.steps)
    with children(_agent, scripts), children(_operator, [(forwards, to_operator)]):
        for _ in links:
            ready.get(timeout=READY_WITHIN_S)
        watch.undeclare()
        began = time.perf_counter()
        for step in traffic.steps:
            for agent, size_bytes in step.frames:
                frames[agent].put(CONTENT[:size_bytes])
            for _ in range(step.answers):
                sample = answers.recv()
                sample.payload.to_bytes()
                if sample.attachment is not None:
                    sample.attachment.to_bytes()
            for size_bytes in step.reports:
                forwarded.put(CONTENT[:size_bytes])
            clock.put(CONTENT[: step.clock_bytes])
        rate = len(traffic.steps) / (time.perf_counter() - began)
        token.undeclare()
    return rate


def _agent(agent: int, script: Sequence[Answer], link: RouterLink) -> None:
    run_in_background()
    with zenoh.open(configured(zenoh.Config, client_pairs(link), link)) as session:
        frames = session.declare_subscriber(KEYS.agent(agent, FRAME), zenoh.handlers.FifoChannel(QUEUE_SAMPLES))
        publishers = {leaf: _publisher(session, KEYS.agent(agent, leaf)) for leaf in (RADIO, REPORT, ACT, TAKEN)}
        watch = session.liveliness().declare_subscriber(KEYS.token(WORLD), lambda _: None, history=True)
        while not all(publisher.matching_status for publisher in publishers.values()):
            time.sleep(POLL_S)
        token = session.liveliness().declare_token(KEYS.token(AGENT, agent))
        for samples in script:
            frames.recv().payload.to_bytes()
            for leaf, payload_bytes, attached_bytes in samples:
                attachment = None if attached_bytes is None else CONTENT[:attached_bytes]
                publishers[leaf].put(CONTENT[:payload_bytes], attachment=attachment)
        token.undeclare()
        watch.undeclare()


def _operator(samples: int, link: RouterLink) -> None:
    run_in_background()
    inbox: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
    take = zenoh.handlers.Callback(inbox.put, indirect=False)
    with zenoh.open(configured(zenoh.Config, client_pairs(link), link)) as session:
        subscribers = [session.declare_subscriber(key, take) for key in (KEYS.forwarded, KEYS.clock)]
        token = session.liveliness().declare_token(KEYS.token(OPERATOR))
        for _ in range(samples):
            inbox.get().payload.to_bytes()
        token.undeclare()
        for subscriber in subscribers:
            subscriber.undeclare()


def _publisher(session: zenoh.Session, key: str, to: zenoh.Locality = zenoh.Locality.ANY) -> zenoh.Publisher:
    return session.declare_publisher(
        key,
        encoding=zenoh.Encoding(f"application/msgpack;deltaswarm.{key.rpartition('/')[2].title()}.v1"),
        congestion_control=zenoh.CongestionControl.BLOCK,
        allowed_destination=to,
    )
