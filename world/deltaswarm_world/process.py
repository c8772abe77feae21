"""The world's process: router, lock-step, clock. With `waker.py` it is all of the world that touches Zenoh."""

import logging
import signal
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from deltaswarm_wire.codec import MAX_SAMPLE_BYTES
from deltaswarm_wire.keys import (
    ACT,
    AGENT,
    FRAME,
    OPERATOR,
    RADIO,
    RECORDER,
    REPORT,
    WORLD,
    Keys,
)
from deltaswarm_wire.messages import Clock, Status, encode_clock, encode_forwarded, encode_frame, encode_status
from deltaswarm_wire.orders import KILL, NOTE, START, ProcessOrder, encode_order
from deltaswarm_wire.session import RouterLink, configured, router_pairs, use_one_worker_thread
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.truth import encode_truth
from deltaswarm_world.core import WorldCore
from deltaswarm_world.output import WorldOutput
from deltaswarm_world.pace import RealTimePace
from deltaswarm_world.waker import Waker

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.world")

GOODBYE_S = 3.0
"""How long the world waits, after the last clock, for the others to have taken all and left."""

STATUS_EVERY_S = 0.5
PORT_TRIES = 20
ANY_PORT = ":0"
STOP_SIGNALS = {signal.SIGTERM, signal.SIGINT}


@dataclass(frozen=True)
class WorldConfig:
    """What the world process is told."""

    run: str
    scenario: Scenario
    link: RouterLink
    credentials: Path
    """File of `user:password` lines, one for each process that may join."""
    out: Path
    expect: tuple[str, ...] = (OPERATOR,)
    """Roles, besides the agents, that must be there before the first step."""
    publish_truth: bool = False
    listen: tuple[str, ...] = ()
    """Endpoints; without any, the link's."""
    boards: tuple[int, ...] = ()
    """Agents on machines of their own, which may leave and come back."""


class WorldProcess:
    """One run of the world over an open router session."""

    def __init__(self, config: WorldConfig, session: zenoh.Session) -> None:
        self._config = config
        self._core = WorldCore(config.scenario, config.boards)
        self._keys = keys = Keys(config.run)
        count = config.scenario.agents.count
        self._channel = session.declare_subscriber(keys.from_agents, zenoh.handlers.FifoChannel(8 * count + 64))
        self._leaf_of = {keys.agent(a, leaf): (a, leaf) for a in range(count) for leaf in (RADIO, REPORT, ACT)}
        self._waker = Waker(session, keys)
        self._frames = [self._publisher(session, keys.agent(agent, FRAME), "Frame") for agent in range(count)]
        self._clock = self._publisher(session, keys.clock, "Clock")
        self._truth = self._publisher(session, keys.truth, "Truth")
        self._forwarded = self._publisher(session, keys.forwarded, "Forwarded")
        self._status = self._publisher(session, keys.status, "Status")
        self._orders = self._publisher(session, keys.orders, "Order")
        self._in_hand: ProcessOrder | None = None
        """What is being done to processes, on order: their tokens come and go as planned."""
        self._status_due = self._probe_due = 0.0
        self._ending = False
        self._there: set[tuple[str, int]] = set()
        self._warned: set[int] = set()
        if self._core.has_uplink:
            log.info("reports pass the uplink model: an operator hears them with --uplink, and only so")
        self._token = session.liveliness().declare_token(keys.token(WORLD))

    @staticmethod
    def _publisher(session: zenoh.Session, key: str, message: str) -> zenoh.Publisher:
        return session.declare_publisher(
            key,
            encoding=zenoh.Encoding(f"application/msgpack;deltaswarm.{message}.v1"),
            congestion_control=zenoh.CongestionControl.BLOCK,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def wait_for_all(self) -> None:
        """Wait until every expected process is there.

        Raises:
            TimeoutError: naming those who are missing.
            InterruptedError: a signal came first.
        """
        settings = self._config.scenario.run
        expected = {(AGENT, agent) for agent in range(self._config.scenario.agents.count)}
        expected |= {(role, 0) for role in self._config.expect}
        self._waker.deadline = time.monotonic() + settings.start_timeout_s
        self._send_status(-1, "waiting")
        while not expected <= self._there:
            if self._waker.stop_requested:
                raise InterruptedError("stopped before the first step")
            if time.monotonic() > self._waker.deadline:
                missing = ", ".join(f"{role} {number}" for role, number in sorted(expected - self._there))
                raise TimeoutError(f"not there after {settings.start_timeout_s:g} s: {missing}")
            self._take(self._channel.recv())

    def run(self, output: WorldOutput) -> bool:
        """All steps; True if none was cut off."""
        settings = self._config.scenario.run
        output.started()
        self._send_status(0, "running")
        tick_s = settings.step_s / settings.real_time_factor
        pace = RealTimePace(tick_s, time.monotonic, time.sleep, log.error) if settings.clock == "realtime" else None
        for step in range(settings.steps):
            for order in self._core.inject(step):
                self._give(order, pace)
            last = step == settings.steps - 1 or self._waker.stop_requested
            self._probe(last)
            for agent, frame in self._core.begin(step, last):
                self._frames[agent].put(encode_frame(frame))
            self._collect(pace)
            tally = self._core.end()
            if self._config.publish_truth:
                self._truth.put(encode_truth(self._core.truth(tally)))
            for forwarded in self._core.forwarded:
                self._forwarded.put(encode_forwarded(forwarded))
            self._clock.put(encode_clock(Clock(step, tally.time_s, last)))
            output.write(tally)
            if time.monotonic() >= self._status_due:
                self._send_status(step, "running")
            self._ending = last
            if self._waker.tokens:
                self._take_tokens()
            if last:
                break
        complete = step == settings.steps - 1
        output.finish(self._core, complete, overruns=pace.overruns if pace else 0)
        self._send_status(step, "ended")
        return complete

    def _probe(self, last: bool) -> None:
        """A board that hung for long gets a frame, as does each that hangs at the end, which else it would miss."""
        now, lockstep = time.monotonic(), self._core.lockstep
        if last or now >= self._probe_due:
            lockstep.probe()
        if now >= self._probe_due or not lockstep.hanging:
            self._probe_due = now + self._config.scenario.run.step_timeout_s

    def _give(self, order: ProcessOrder, pace: RealTimePace | None) -> None:
        """Have the orchestrator do something to processes; the step that comes does not begin before it is done.

        Raises:
            TimeoutError: it was not done in time.
        """
        log.warning("%s", order.text)
        self._orders.put(encode_order(order))
        if order.action == NOTE:
            return
        began = time.monotonic()
        self._waker.deadline = began + self._config.scenario.run.start_timeout_s
        self._in_hand = order
        while not self._is_done(order):
            if self._take(self._channel.recv()) and time.monotonic() >= self._waker.deadline:
                if self._waker.stop_requested:
                    break
                raise TimeoutError(f"not done within {time.monotonic() - began:.0f} s: {order.text}")
        self._in_hand = None
        if pace:
            pace.pause(time.monotonic() - began)

    def _is_done(self, order: ProcessOrder) -> bool:
        tokens = [(AGENT, agent) in self._there for agent in order.agents]
        as_told = {KILL: not any(tokens), START: all(tokens)}.get(order.action, True)
        return as_told and order.number in self._waker.done

    def _collect(self, pace: RealTimePace | None) -> None:
        """Wait until every agent has closed the step, or its time is up; where all hang, for the first to return.

        Agents that sleep take part, so a step in which nobody is asked is not waited for.
        """
        lockstep = self._core.lockstep
        timeout_s = self._config.scenario.run.step_timeout_s
        self._waker.deadline = pace.next_tick() if pace else time.monotonic() + timeout_s
        hanging = 0 if lockstep.taking_part() else len(lockstep.hanging)
        while not lockstep.is_closed or (hanging and len(lockstep.hanging) == hanging):
            if self._take(self._channel.recv()) and time.monotonic() >= self._waker.deadline:
                for agent in lockstep.waiting:
                    log.warning("step %d goes on without agent %d, which hangs", lockstep.step, agent)
                break
        if pace:
            pace.wait()
        while (sample := self._channel.try_recv()) is not None:
            self._take(sample)  # who was late takes part again in the next step

    def _take(self, sample: zenoh.Sample) -> bool:
        """Take one sample; True if it was only a wake-up."""
        source = self._leaf_of.get(str(sample.key_expr))
        if source is None:
            self._take_tokens()
            return True
        agent, leaf = source
        reason: str | None
        if leaf == REPORT:
            reason = self._take_report(agent, sample)
        elif leaf == RADIO:
            reason = self._core.hear_radio(agent, sample.payload.to_bytes())
            if sample.attachment is not None:  # the act that closes the step rides on it
                reason = self._take_act(agent, sample.attachment) or reason
        else:
            reason = self._take_act(agent, sample.payload)
        if reason is not None and agent not in self._warned:
            self._warned.add(agent)
            log.warning("a sample on a key of agent %d was dropped (further ones are only counted): %s", agent, reason)
        return False

    def _take_act(self, agent: int, data: zenoh.ZBytes) -> str | None:
        """Let an act close its agent's step, or end the agent's hanging. The reason if it is dropped."""
        lockstep = self._core.lockstep
        was_hanging = agent in lockstep.hanging
        reason = self._core.hear_act(agent, data.to_bytes())
        if was_hanging and agent not in lockstep.hanging:
            log.info("agent %d, which hung, answers again in step %d", agent, lockstep.step)
        return reason

    def _take_report(self, agent: int, sample: zenoh.Sample) -> str | None:
        """A report is the uplink's; without one the operator gets it by itself. The reason if it is dropped."""
        size_bytes = len(sample.payload)
        if size_bytes > MAX_SAMPLE_BYTES:
            return self._core.reject(agent, f"report: {size_bytes} bytes, at most {MAX_SAMPLE_BYTES} are allowed")
        if self._core.has_uplink:
            return self._core.hear_report(agent, sample.payload.to_bytes())
        self._core.reports_passing += 1
        return None

    def _take_tokens(self) -> None:
        """Take note of who came and who went.

        Raises:
            ConnectionError: the operator went.
        """
        lockstep = self._core.lockstep
        while self._waker.tokens:
            role, number, there = self._waker.tokens.popleft()
            (self._there.add if there else self._there.discard)((role, number))
            if role == AGENT and self._in_hand is not None and number in self._in_hand.agents:
                continue
            if role == AGENT and number < self._config.scenario.agents.count:
                (lockstep.back if there else lockstep.gone)(number)
                if there and number in lockstep.boards:
                    self._core.board_is_back(number)
                if lockstep.step >= 0 and not self._ending:
                    log.warning("agent %d %s in step %d", number, "is back" if there else "is gone", lockstep.step)
            elif role == OPERATOR and not there and lockstep.step >= 0 and not self._ending:
                raise ConnectionError(f"the operator is gone in step {lockstep.step}")

    def _send_status(self, step: int, phase: str) -> None:
        self._status_due = time.monotonic() + STATUS_EVERY_S
        core = self._core
        settings = self._config.scenario.run
        self._status.put(
            encode_status(
                Status(
                    max(step, 0),
                    settings.steps,
                    max(step, 0) * settings.step_s,
                    len(core.lockstep.alive),
                    core.agents_in_trees,
                    core.environment.mean_waiting_s(),
                    phase,
                )
            )
        )

    def goodbye(self) -> None:
        """Let operator and recorder take what was sent and leave; then the world's token goes."""
        self._waker.deadline = time.monotonic() + GOODBYE_S
        while any(role in (OPERATOR, RECORDER) for role, _ in self._there):
            if self._take(self._channel.recv()) and time.monotonic() >= self._waker.deadline:
                log.warning("not all parts left within %g s", GOODBYE_S)
                break
        self._token.undeclare()

    def close(self) -> None:
        """End the threads of its own."""
        self._waker.close()


def run_world(config: WorldConfig, announce: Callable[[str], None]) -> int:
    """Be the router and the world of one run; the process's exit code.

    `announce` is told the endpoints, with spaces between them, once the router listens on them.
    """
    early: list[int] = []
    for number in STOP_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda number, _: early.append(number))
    zenoh.init_log_from_env_or("error")
    keys = Keys(config.run)
    with WorldOutput(config.out) as output, _open_router(config, keys, announce) as session:
        world = WorldProcess(config, session)
        if early:  # the signal came before anything waited for it
            signal.raise_signal(early[0])
        try:
            world.wait_for_all()
            complete = world.run(output)
            world.goodbye()
        except (TimeoutError, ConnectionError, InterruptedError) as error:
            log.error("the run ends: %s", error)
            complete = False
        finally:
            world.close()
    return 0 if complete else 1


def _open_router(config: WorldConfig, keys: Keys, announce: Callable[[str], None]) -> zenoh.Session:
    """Listen where asked; port 0 is any free one."""
    agents = range(config.scenario.agents.count)
    asked = config.listen or (config.link.endpoint,)
    may_retry = any(endpoint.endswith(ANY_PORT) for endpoint in asked)
    for attempt in range(PORT_TRIES):
        endpoints = [_with_port(endpoint) for endpoint in asked]
        uplink = config.scenario.uplink.is_on
        pairs = router_pairs(config.link, str(config.credentials), keys, agents, endpoints, uplink=uplink)
        try:
            session = zenoh.open(configured(zenoh.Config, pairs, config.link))
        except zenoh.ZError as error:
            if not may_retry or attempt == PORT_TRIES - 1:
                raise ConnectionError(f"the router cannot be opened: {error}") from None
        else:
            announce(" ".join(endpoints))
            return session
    raise AssertionError("unreachable")


def _with_port(endpoint: str) -> str:
    return f"{endpoint.removesuffix(ANY_PORT)}:{_free_port()}" if endpoint.endswith(ANY_PORT) else endpoint


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
