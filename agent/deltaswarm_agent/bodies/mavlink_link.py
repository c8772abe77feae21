"""The bytes between a board and its autopilot: UDP, TCP or a serial line, spelled as MAVLink's tools spell them.

pymavlink's own `mavutil` has such links too, but costs an agent 15 to 26 MB, and its TCP holds up the thread that
must have the vehicle stand. Here nothing waits longer than asked, and a link that broke is opened again at the next
`receive`.
"""

import contextlib
import select
import socket
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

UDP_IN = ("udpin", "udp")
UDP_OUT = "udpout"
TCP = "tcp"
READ_BYTES = 4096
"""More than a datagram with MAVLink in it can have."""
CONNECT_S = 1.0
WRITE_S = 0.2


class Device(NamedTuple):
    """Where the autopilot is: `udpin`, `udpout` or `tcp` with a host, or `serial` with a path; port or baud."""

    kind: str
    name: str
    number: int


def parse_device(text: str, baud: int) -> Device:
    """What a connection string means. `baud` is for a serial line whose string names none.

    Raises:
        ValueError: what is wrong with it.
    """
    kind, colon, rest = text.partition(":")
    if kind in (*UDP_IN, UDP_OUT, TCP) and colon:
        host, colon, port = rest.rpartition(":")
        if not (host and colon and port.isdecimal() and 1 <= int(port) <= 0xFFFF):
            raise ValueError(f"{kind}:HOST:PORT is allowed, with a port of 1 to 65535")
        return Device(UDP_IN[0] if kind in UDP_IN else kind, host, int(port))
    if text.startswith("/"):
        path, comma, rate = text.partition(",")
        if comma and not (rate.isdecimal() and int(rate) > 0):
            raise ValueError("after the comma, a serial device's baud rate is allowed")
        return Device("serial", path, int(rate) if comma else baud)
    raise ValueError("udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, or a serial device such as /dev/ttyACM0")


class Link(Protocol):
    """One of the three. Every call but `close` raises OSError when the link is broken."""

    def receive(self, wait_s: float) -> bytes:
        """What came, after waiting so long at most [s]; nothing if nothing came."""

    def write(self, data: bytes) -> None:
        """Send a message; it is lost while nobody is known to send to."""

    def close(self) -> None:
        """Hang up."""


def open_link(device: Device) -> Link:
    """The link to a device.

    Raises:
        OSError: it cannot be opened.
        ImportError: pyserial is not installed.
    """
    if device.kind == "serial":
        return SerialLink(device.name, device.number)
    if device.kind == TCP:
        return TcpLink(device.name, device.number)
    return UdpLink(device.name, device.number, listens=device.kind in UDP_IN)


@contextlib.contextmanager
def _hanging_up_on_error(link: Link) -> Iterator[None]:
    """A link on which anything failed is opened anew by the next `receive`."""
    try:
        yield
    except OSError:
        link.close()
        raise


class UdpLink:
    """Listens, and answers whoever spoke last; or speaks to one address."""

    def __init__(self, host: str, port: int, *, listens: bool) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            if listens:
                self._socket.bind((host, port))
            else:
                self._socket.connect((host, port))
        except OSError:
            self._socket.close()
            raise
        self._listens = listens
        self._peer: Any = None

    def receive(self, wait_s: float) -> bytes:
        """One datagram."""
        self._socket.settimeout(wait_s)
        try:
            data, sender = self._socket.recvfrom(READ_BYTES)
        except TimeoutError:
            return b""
        if self._listens:
            self._peer = sender
        return data

    def write(self, data: bytes) -> None:
        """One datagram."""
        if not self._listens:
            self._socket.send(data)
        elif self._peer is not None:
            self._socket.sendto(data, self._peer)

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


class TcpLink:
    """A client."""

    def __init__(self, host: str, port: int) -> None:
        self._address = (host, port)
        self._socket: socket.socket | None = self._opened()

    def _opened(self) -> socket.socket:
        opened = socket.create_connection(self._address, CONNECT_S)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return opened

    def receive(self, wait_s: float) -> bytes:
        """What there is."""
        if self._socket is None:
            self._socket = self._opened()
        self._socket.settimeout(wait_s)
        with _hanging_up_on_error(self):
            try:
                data = self._socket.recv(READ_BYTES)
            except TimeoutError:
                return b""
            if not data:
                raise ConnectionResetError(f"{self._address[0]}:{self._address[1]} hung up")
        return data

    def write(self, data: bytes) -> None:
        """All of it, or the link is broken: half a message would spoil the next."""
        if self._socket is None:
            return
        self._socket.settimeout(WRITE_S)
        with _hanging_up_on_error(self):
            self._socket.sendall(data)

    def close(self) -> None:
        """Hang up."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class SerialLink:
    """A serial line. Needs `pyserial`."""

    def __init__(self, path: str, baud: int) -> None:
        self._path, self._baud = path, baud
        self._port: Any = self._opened()

    def _opened(self) -> Any:
        import serial  # nobody else needs it

        return serial.Serial(self._path, self._baud, timeout=0, write_timeout=WRITE_S)

    def receive(self, wait_s: float) -> bytes:
        """What there is."""
        if self._port is None:
            self._port = self._opened()
        with _hanging_up_on_error(self):
            if not select.select([self._port], [], [], wait_s)[0]:
                return b""
            data: bytes = self._port.read(READ_BYTES)  # raises if there is nothing after all: the device is gone
        return data

    def write(self, data: bytes) -> None:
        """All of it, or the link is broken."""
        if self._port is None:
            return
        with _hanging_up_on_error(self):
            self._port.write(data)

    def close(self) -> None:
        """Hang up."""
        if self._port is not None:
            with contextlib.suppress(OSError):  # a device that was pulled out
                self._port.close()
            self._port = None
