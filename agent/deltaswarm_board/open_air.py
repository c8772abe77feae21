"""Open air: each board publishes its radio frames on its own key and subscribes to its neighbours' `agent/*/radio`.

This is the only file of a board that uses Zenoh. Nothing here waits for a link: a sample that cannot be sent at once
is dropped, as in any radio, and a separate thread opens the session and watches its links.
"""

import logging
import socket
import threading
import time

from deltaswarm_board.inbox import RadioInbox
from deltaswarm_board.settings import BoardSettings
from deltaswarm_wire.codec import pack
from deltaswarm_wire.envelope import Sent, encode_sent
from deltaswarm_wire.keys import AGENT, HEALTH, RADIO, REPORT, Keys, parse_agent_key
from deltaswarm_wire.messages import Heard
from deltaswarm_wire.operator_messages import Health, encode_health
from deltaswarm_wire.session import QUIC, WITH_PORT, configured, host_and_port, protocol_of, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.air")

RETRY_S = 1.0
STALLS_S, STALLS_STEPS = 2.0, 5
"""A board that has not stepped for this wall time and this many steps is reported as not well."""
CLOSE_S = 1.0
"""A session that does not open or close within this time is left to the exit of the process."""


def cannot_listen(endpoint: str) -> str:
    """Return why listening on a network endpoint fails at present; "" if it works."""
    protocol = protocol_of(endpoint)
    if protocol not in WITH_PORT:
        return ""
    is_stream = protocol not in ("udp", QUIC)
    try:
        host, port = host_and_port(endpoint)
        wanted = socket.SOCK_STREAM if is_stream else socket.SOCK_DGRAM
        # The host as bytes: for text Python loads tables of 1 MB.
        [family, kind, _, _, address], *_ = socket.getaddrinfo(host.encode(), port, type=wanted)
        with socket.socket(family, kind) as probe:
            if is_stream:
                probe.setsockopt(
                    socket.SOL_SOCKET, socket.SO_REUSEADDR, 1
                )  # as Zenoh, so that a restart can reuse the port
            probe.bind(address)
    except OSError as error:
        return str(error)
    return ""


class OpenAir:
    """The air of one board, and its link to the operator."""

    def __init__(self, settings: BoardSettings) -> None:
        self._settings = settings
        self._keys = Keys(settings.run)
        self._config = configured(zenoh.Config, settings.pairs, settings.air.link(settings.user))
        self._inbox = RadioInbox(settings.id, settings.air.stale_s, settings.air.range_m, settings.agent.step_s)
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._opener = threading.Thread(target=self._keep_opening, name="air", daemon=True)
        self._session: zenoh.Session | None = None
        self._radio: zenoh.Publisher | None = None
        self._report: zenoh.Publisher | None = None
        self._health: zenoh.Publisher | None = None
        self.unsent = 0
        """Number of samples that could not be sent."""
        self.links = 0
        """Number of present links with boards, operators and routers."""

    def open(self, accelerate: float = 1.0) -> None:
        """Start connecting, and start the agent's clock, `accelerate` times as fast as the wall clock."""
        self._accelerate = accelerate
        self._start_s = time.monotonic()
        self._stepped_s = 0.0
        self._stalls = False
        zenoh.init_log_from_env_or("error")
        if self._settings.air.tls.ca_file and not self._settings.air.agents:
            log.warning("air.agents is empty: every process with a certificate can act as any agent")
        self._opener.start()

    @property
    def counts(self) -> str:
        with self._lock:
            dropped = ", ".join(f"{count} {reason}" for reason, count in sorted(self._inbox.dropped.items()) if count)
            heard = f"heard {self._inbox.heard}; dropped {dropped or 'none'}; unsent {self.unsent}"
        return f"{heard}; links {self.links}"

    def now_s(self) -> float:
        """Return the time of the agent's monotonic clock [s since `open`]."""
        return (time.monotonic() - self._start_s) * self._accelerate

    def receive(self, place_m: tuple[float, float]) -> tuple[Heard, ...]:
        """Take the frames since the last step, for an agent at a position [m]."""
        self._stepped_s = self.now_s()
        if self._stalls:
            self._stalls = False
            self.health("")
        with self._lock:
            return self._inbox.empty(self.now_s(), place_m)

    def send(self, data: bytes, place_m: tuple[float, float]) -> None:
        """Broadcast one radio frame from a position [m]."""
        self._put(self._radio, data, encode_sent(Sent(self.now_s(), *place_m)))

    def report(self, data: bytes) -> None:
        """Send one report to the operator, with the board's wall clock [Unix s] attached."""
        self._put(self._report, data, pack(time.time()))

    def health(self, fault: str) -> None:
        """Send the operator the fault of the body; "" if it is well."""
        self._put(self._health, encode_health(Health(fault)))

    def close(self) -> bool:
        """Leave; the liveliness token goes at once. Return False if bad links keep the session from closing in time."""
        self._closing.set()
        if self._opener.is_alive():
            self._opener.join(CLOSE_S)
            if self._opener.is_alive():
                return False
        session, self._session = self._session, None
        if session is not None:
            closer = threading.Thread(target=session.close, daemon=True)
            closer.start()
            closer.join(CLOSE_S)
            return not closer.is_alive()
        return True

    def _put(self, publisher: zenoh.Publisher | None, data: bytes, attachment: bytes | None = None) -> None:
        try:
            if publisher is not None:
                publisher.put(data, attachment=attachment)
                return
        except zenoh.ZError as error:
            log.debug("sample not sent: %s", error)
        self.unsent += 1

    # In separate threads

    def _tell_of_taken_ports(self) -> None:
        """Warn of endpoints in use: Zenoh retries silently without end, since an address may appear later."""
        for endpoint in self._settings.air.listen:
            if problem := cannot_listen(endpoint):
                log.warning("cannot listen on %s yet, so no board can connect to it: %s", endpoint, problem)

    def _keep_opening(self) -> None:
        last_error = ""
        self._tell_of_taken_ports()
        while not self._closing.is_set():
            try:
                session = zenoh.open(self._config)
                self._begin(session)
                self._watch(session)
            except zenoh.ZError as error:
                if str(error) != last_error:
                    log.warning("no session yet, retrying: %s", error)
                last_error = str(error)
                self._closing.wait(RETRY_S)

    def _begin(self, session: zenoh.Session) -> None:
        keys, agent = self._keys, self._settings.id
        hears = zenoh.handlers.Callback(self._on_radio, indirect=False)
        self._subscriber = session.declare_subscriber(keys.all_radio, hears, allowed_origin=zenoh.Locality.REMOTE)
        self._report = self._publisher(session, REPORT, "Report", zenoh.Reliability.RELIABLE)
        self._health = self._publisher(session, HEALTH, "Health", zenoh.Reliability.RELIABLE)
        self._radio = self._publisher(session, RADIO, "Radio", zenoh.Reliability.BEST_EFFORT)
        self._token = session.liveliness().declare_token(keys.token(AGENT, agent))
        self._session = session
        log.info("agent %d is on the air of run %s", agent, keys.run)

    def _watch(self, session: zenoh.Session) -> None:
        """Until the end, log changes of links and report an agent that does not step."""
        longest_s = max(STALLS_S * self._accelerate, STALLS_STEPS * self._settings.agent.step_s)
        while not self._closing.wait(RETRY_S):
            stalled_s = self.now_s() - self._stepped_s
            if stalled_s > longest_s:
                self._stalls = True
                self.health(f"it has not stepped for {stalled_s:.0f} s")
            links = len(session.info.peers_zid()) + len(session.info.routers_zid())
            if links != self.links:
                log.info("links: %d (was %d)", links, self.links)
                self.links = links

    def _publisher(
        self, session: zenoh.Session, leaf: str, message: str, reliability: zenoh.Reliability
    ) -> zenoh.Publisher:
        return session.declare_publisher(
            self._keys.agent(self._settings.id, leaf),
            encoding=zenoh.Encoding(f"application/msgpack;deltaswarm.{message}.v1"),
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=reliability,
        )

    def _on_radio(self, sample: zenoh.Sample) -> None:
        source = parse_agent_key(str(sample.key_expr))
        sender = source[0] if source else None
        sent = sample.attachment
        with self._lock:
            now_s = self.now_s()
            reason = self._inbox.refuse(sender, now_s) or self._inbox.accept(
                sender, sample.payload.to_bytes(), None if sent is None else sent.to_bytes(), now_s
            )
            is_news = bool(reason) and self._inbox.is_news(sender, reason)
        if is_news:
            log.warning("dropped a frame on %s: %s (more are only counted)", sample.key_expr, reason)
