"""Open air: each board publishes its radio frames on its own key and hears `agent/*/radio` of its neighbours.

The one file of a board that touches Zenoh. Nothing here ever waits for a link: what cannot be sent at once is
dropped, as in any radio, and the session is opened and its links are watched in a thread of its own.
"""

import logging
import socket
import threading
import time

from deltaswarm_agent.board.inbox import Inbox, Sent, encode_sent
from deltaswarm_agent.board.settings import BoardSettings
from deltaswarm_wire.codec import pack
from deltaswarm_wire.endpoints import QUIC, WITH_PORT, host_and_port, protocol_of
from deltaswarm_wire.keys import AGENT, HEALTH, RADIO, REPORT, Keys, parse_agent_key
from deltaswarm_wire.messages import Heard
from deltaswarm_wire.operator_messages import Health, encode_health
from deltaswarm_wire.session import configured, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.air")

RETRY_S = 1.0
STALLS_S, STALLS_STEPS = 2.0, 5
"""A board that has not stepped for so long by the wall, and for so many steps, is told of as not well."""
CLOSE_S = 1.0
"""A session that does not open or close within this is left to the end of the process."""


def cannot_listen(endpoint: str) -> str:
    """Why nobody can listen on a network's endpoint now; nothing if one can."""
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
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # after a restart it is free, as for Zenoh
            probe.bind(address)
    except OSError as error:
        return str(error)
    return ""


class OpenAir:
    """The air of one board, and its way to the operator.

    Raises:
        ValueError: Zenoh refuses the settings.
    """

    def __init__(self, settings: BoardSettings) -> None:
        self._settings = settings
        self._keys = Keys(settings.run)
        self._config = configured(zenoh.Config, settings.pairs, settings.air.link(settings.user))
        self._inbox = Inbox(settings.id, settings.air.stale_s, settings.air.range_m)
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._opener = threading.Thread(target=self._keep_opening, name="air", daemon=True)
        self._session: zenoh.Session | None = None
        self._radio: zenoh.Publisher | None = None
        self._report: zenoh.Publisher | None = None
        self._health: zenoh.Publisher | None = None
        self.unsent = 0
        """Samples that found no session."""
        self.links = 0
        """Boards, operators and routers that it has a link with now."""

    def open(self, accelerate: float = 1.0) -> None:
        """Begin to look for others; the agent's clock begins now, and runs so much faster than the wall's."""
        self._accelerate = accelerate
        self._start_s = time.monotonic()
        self._stepped_s = 0.0
        self._stalls = False
        zenoh.init_log_from_env_or("error")
        if self._settings.air.tls.ca_file and not self._settings.air.agents:
            log.warning("without air.agents whoever has a certificate is believed, whatever number it gives")
        self._opener.start()

    @property
    def counts(self) -> str:
        """What was heard and what was not, for the log."""
        with self._lock:
            dropped = ", ".join(f"{count} {reason}" for reason, count in sorted(self._inbox.dropped.items()) if count)
            heard = f"heard {self._inbox.heard}; dropped {dropped or 'none'}; unsent {self.unsent}"
        return f"{heard}; links {self.links}"

    def now_s(self) -> float:
        """The agent's own clock [s since `open`]: no clock of the calendar, which may be set."""
        return (time.monotonic() - self._start_s) * self._accelerate

    def hear(self, place_m: tuple[float, float]) -> tuple[Heard, ...]:
        """What came since the last step, for an agent at a place [m]."""
        self._stepped_s = self.now_s()
        if self._stalls:
            self._stalls = False
            self.health("")
        with self._lock:
            return self._inbox.empty(self.now_s(), place_m)

    def say(self, data: bytes, place_m: tuple[float, float]) -> None:
        """Put one radio frame on the air, from a place [m]."""
        self._put(self._radio, data, encode_sent(Sent(self.now_s(), *place_m)))

    def report(self, data: bytes) -> None:
        """Send one report to the operator, with the board's own wall clock [Unix s] beside it."""
        self._put(self._report, data, pack(time.time()))

    def health(self, fault: str) -> None:
        """Tell the operator what is wrong with the body; nothing, if it is well."""
        self._put(self._health, encode_health(Health(fault)))

    def close(self) -> bool:
        """Leave: the liveliness token goes at once. False where links are so bad that the session is not closed yet."""
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
            log.debug("nothing was sent: %s", error)
        self.unsent += 1

    # In threads of their own

    def _tell_of_taken_ports(self) -> None:
        """Zenoh tries to listen for ever, and in silence, since an address may come later than the board."""
        for endpoint in self._settings.air.listen:
            if problem := cannot_listen(endpoint):
                log.warning("cannot listen on %s yet, and nobody connects to it there: %s", endpoint, problem)

    def _keep_opening(self) -> None:
        told = ""
        self._tell_of_taken_ports()
        while not self._closing.is_set():
            try:
                session = zenoh.open(self._config)
                self._begin(session)
                self._watch(session)
            except zenoh.ZError as error:
                if str(error) != told:
                    log.warning("no session yet, trying again: %s", error)
                told = str(error)
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
        """Tell of links that come and go, and of an agent that does not step, until the end."""
        longest_s = max(STALLS_S * self._accelerate, STALLS_STEPS * self._settings.agent.step_s)
        while not self._closing.wait(RETRY_S):
            stalled_s = self.now_s() - self._stepped_s
            if stalled_s > longest_s:
                self._stalls = True
                self.health(f"it has not stepped for {stalled_s:.0f} s")
            links = len(session.info.peers_zid()) + len(session.info.routers_zid())
            if links != self.links:
                log.info("links: %d now, %d before", links, self.links)
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
            reason = self._inbox.refuse(sender, now_s) or self._inbox.take(
                sender, sample.payload.to_bytes(), None if sent is None else sent.to_bytes(), now_s
            )
            is_news = bool(reason) and self._inbox.is_news(sender, reason)
        if is_news:
            log.warning("dropped (further ones are only counted): a frame on %s is %s", sample.key_expr, reason)
