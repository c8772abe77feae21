"""The bytes between a board and its autopilot: UDP, TCP or a serial line, spelled as MAVLink's tools spell them.

pymavlink's own `mavutil` has such links too, but costs an agent 15 to 26 MB, and its TCP holds up the thread that
must have the vehicle stand. Here nothing waits longer than asked, and a link that is not open yet, or broke, is opened
at the next `receive`: an autopilot may come after its board, and go.
"""

import abc
import contextlib
import select
import socket
import termios
from collections.abc import Iterator
from typing import Any, NamedTuple

UDP_IN = ("udpin", "udp")
UDP_OUT = "udpout"
TCP = "tcp"
READ_BYTES = 4096
"""More than a datagram with MAVLink in it can have."""
MIN_BAUD, MAX_BAUD = 1200, 10_000_000
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
        return Device(UDP_IN[0] if kind in UDP_IN else kind, _without_brackets(host), int(port))
    if text.startswith("/"):
        path, comma, rate = text.partition(",")
        if comma and not (rate.isdecimal() and MIN_BAUD <= int(rate) <= MAX_BAUD):
            raise ValueError(f"after the comma, a serial device's baud rate of {MIN_BAUD} to {MAX_BAUD} is allowed")
        return Device("serial", path, int(rate) if comma else baud)
    raise ValueError("udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, or a serial device such as /dev/ttyACM0")


def _without_brackets(host: str) -> str:
    """A host's name or address; of IPv6 one is written in brackets, and may end in `%` and an interface's name."""
    bare = host.removeprefix("[").removesuffix("]")
    if ":" not in host and bare == host:
        return host
    try:
        socket.inet_pton(socket.AF_INET6, bare.partition("%")[0] if host == f"[{bare}]" else "")
    except OSError:
        raise ValueError(f"for {host!r}, a name, an IPv4 address or an IPv6 address in [] is allowed") from None
    return bare


class Link(abc.ABC):
    """One of the three. Every call but `close` raises OSError when the link is broken, or cannot be opened."""

    def __init__(self) -> None:
        self._end: Any = None
        """The socket or serial port; None while it is not open."""

    def open(self) -> None:
        """Open it, unless it is open."""
        if self._end is not None:
            return
        try:
            self._end = self._opened()
        except (ValueError, termios.error) as error:  # a name that can be none, or a rate that the device refuses
            raise OSError(str(error)) from error

    def receive(self, wait_s: float) -> bytes:
        """What came, after waiting so long at most [s]; nothing if nothing came. Opens what is not open."""
        self.open()
        with self._hanging_up_on_error():
            return self._read(wait_s)

    def write(self, data: bytes) -> None:
        """Send a message; it is lost while the link is not open, or nobody is known to send to."""
        if self._end is not None:
            with self._hanging_up_on_error():
                self._send(data)

    def close(self) -> None:
        """Hang up."""
        if self._end is not None:
            with contextlib.suppress(OSError):  # a device that was pulled out
                self._end.close()
            self._end = None

    @contextlib.contextmanager
    def _hanging_up_on_error(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            self.close()
            raise

    @abc.abstractmethod
    def _opened(self) -> Any:
        """A new end."""

    @abc.abstractmethod
    def _read(self, wait_s: float) -> bytes:
        """As `receive`, from an end that is open."""

    @abc.abstractmethod
    def _send(self, data: bytes) -> None:
        """As `write`, to an end that is open."""


def open_link(device: Device) -> Link:
    """The link to a device, which need not be there yet.

    Raises:
        ImportError: pyserial is not installed.
    """
    if device.kind == "serial":
        return SerialLink(device.name, device.number)
    if device.kind == TCP:
        return TcpLink(device.name, device.number)
    return UdpLink(device.name, device.number, listens=device.kind in UDP_IN)


class UdpLink(Link):
    """Listens, and answers whoever spoke last; or speaks to one address. Reads one datagram."""

    def __init__(self, host: str, port: int, *, listens: bool) -> None:
        super().__init__()
        self._address = (host, port)
        self._listens = listens
        self._peer: Any = None

    def _opened(self) -> socket.socket:
        host, port = self._address
        # As bytes, since for text Python loads tables of 1 MB. IPv4 first, which is what autopilots speak.
        found = socket.getaddrinfo(host.encode(), port, type=socket.SOCK_DGRAM)
        family, *_, address = min(found, key=lambda one: one[0] != socket.AF_INET)
        opened = socket.socket(family, socket.SOCK_DGRAM)
        try:
            (opened.bind if self._listens else opened.connect)(address)
        except OSError:
            opened.close()
            raise
        return opened

    def _read(self, wait_s: float) -> bytes:
        self._end.settimeout(wait_s)
        try:
            data, self._peer = self._end.recvfrom(READ_BYTES)
        except TimeoutError:
            return b""
        return bytes(data)

    def _send(self, data: bytes) -> None:
        if not self._listens:
            self._end.send(data)
        elif self._peer is not None:
            self._end.sendto(data, self._peer)


class TcpLink(Link):
    """A client."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        self._address = (host, port)

    def _opened(self) -> socket.socket:
        opened = socket.create_connection(self._address, CONNECT_S)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return opened

    def _read(self, wait_s: float) -> bytes:
        self._end.settimeout(wait_s)
        try:
            data: bytes = self._end.recv(READ_BYTES)
        except TimeoutError:
            return b""
        if not data:
            raise ConnectionResetError("the other end hung up")
        return data

    def _send(self, data: bytes) -> None:
        self._end.settimeout(WRITE_S)
        self._end.sendall(data)  # all of it, or the link is broken: half a message would spoil the next


class SerialLink(Link):
    """A serial line. Needs `pyserial`."""

    def __init__(self, path: str, baud: int) -> None:
        import serial  # nobody else needs it

        super().__init__()
        self._make: Any = serial.Serial
        self._path, self._baud = path, baud

    def _opened(self) -> Any:
        return self._make(self._path, self._baud, timeout=0, write_timeout=WRITE_S)

    def _read(self, wait_s: float) -> bytes:
        if not select.select([self._end], [], [], wait_s)[0]:
            return b""
        data: bytes = self._end.read(READ_BYTES)  # raises if there is nothing after all: the device is gone
        return data

    def _send(self, data: bytes) -> None:
        self._end.write(data)
