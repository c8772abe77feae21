"""The link between a board and its autopilot: UDP, TCP or serial, with the connection strings of MAVLink's tools.

pymavlink's own `mavutil` has such links, too, but costs an agent 15 to 26 MB, and its TCP blocks the thread that must
stop the vehicle. Here no call waits longer than requested, and `receive` opens a link that is closed or broken: an
autopilot may appear after its board, and disappear.
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
"""More than the largest datagram with MAVLink."""
MIN_BAUD, MAX_BAUD = 1200, 10_000_000
CONNECT_S = 1.0
WRITE_S = 0.2


class Device(NamedTuple):
    """Address of the autopilot: `udpin`, `udpout` or `tcp` with host and port, or `serial` with path and baud rate."""

    kind: str
    name: str
    number: int


def parse_device(text: str, baud: int) -> Device:
    """Parse a connection string. `baud` is the default for a serial device."""
    kind, colon, rest = text.partition(":")
    if kind in (*UDP_IN, UDP_OUT, TCP) and colon:
        host, colon, port = rest.rpartition(":")
        if not (host and colon and port.isdecimal() and 1 <= int(port) <= 0xFFFF):
            raise ValueError(f"must be {kind}:HOST:PORT, with a port from 1 to 65535")
        return Device(UDP_IN[0] if kind in UDP_IN else kind, _without_brackets(host), int(port))
    if text.startswith("/"):
        path, comma, rate = text.partition(",")
        if comma and not (rate.isdecimal() and MIN_BAUD <= int(rate) <= MAX_BAUD):
            raise ValueError(f"must have a baud rate from {MIN_BAUD} to {MAX_BAUD} after the comma")
        return Device("serial", path, int(rate) if comma else baud)
    raise ValueError("must be udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, or a path such as /dev/ttyACM0")


def _without_brackets(host: str) -> str:
    """Check a host; an IPv6 address is in brackets and may end in `%` and an interface's name."""
    bare = host.removeprefix("[").removesuffix("]")
    if ":" not in host and bare == host:
        return host
    try:
        socket.inet_pton(socket.AF_INET6, bare.partition("%")[0] if host == f"[{bare}]" else "")
    except OSError:
        raise ValueError(f"must have a name, an IPv4 address, or an IPv6 address in [] as host, not {host!r}") from None
    return bare


class MavlinkLink(abc.ABC):
    """A link. Every method except `close` raises OSError if the link is broken or cannot be opened."""

    def __init__(self) -> None:
        self._end: Any = None
        """The socket or serial port; None while closed."""
        self.sender: Any = None
        """The address that the newest data came from, where others may send to this link; else None."""
        self.peer: Any = None
        """The address to send to, where there is a choice; None: nobody is sent anything."""

    def open(self) -> None:
        if self._end is not None:
            return
        try:
            self._end = self._opened()
        except (ValueError, termios.error) as error:  # an impossible name, or a rate that the device refuses
            raise OSError(str(error)) from error

    def receive(self, wait_s: float) -> bytes:
        """Wait up to `wait_s` for data; return b"" if there is none. Opens the link if it is closed."""
        self.open()
        with self._hanging_up_on_error():
            return self._read(wait_s)

    def write(self, data: bytes) -> None:
        """Send a message; without an open link or a known peer it is lost."""
        if self._end is not None:
            with self._hanging_up_on_error():
                self._send(data)

    def close(self) -> None:
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
        """Open a socket or port."""

    @abc.abstractmethod
    def _read(self, wait_s: float) -> bytes:
        """Implement `receive` on an open link."""

    @abc.abstractmethod
    def _send(self, data: bytes) -> None:
        """Implement `write` on an open link."""


def open_link(device: Device) -> MavlinkLink:
    """Make the link to a device, which need not exist yet."""
    if device.kind == "serial":
        return SerialLink(device.name, device.number)
    if device.kind == TCP:
        return TcpLink(device.name, device.number)
    return UdpLink(device.name, device.number, listens=device.kind in UDP_IN)


class UdpLink(MavlinkLink):
    """Listens and sends to its `peer`, which its owner chooses, or sends to one address. Reads one datagram."""

    def __init__(self, host: str, port: int, *, listens: bool) -> None:
        super().__init__()
        self._address = (host, port)
        self._listens = listens

    def _opened(self) -> socket.socket:
        host, port = self._address
        # As bytes: for text Python loads tables of 1 MB. IPv4 first, as autopilots use it.
        addresses = socket.getaddrinfo(host.encode(), port, type=socket.SOCK_DGRAM)
        family, *_, address = min(addresses, key=lambda candidate: candidate[0] != socket.AF_INET)
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
            data, sender = self._end.recvfrom(READ_BYTES)
        except TimeoutError:
            return b""
        if self._listens:
            self.sender = sender
        return bytes(data)

    def _send(self, data: bytes) -> None:
        if not self._listens:
            self._end.send(data)
        elif self.peer is not None:
            self._end.sendto(data, self.peer)


class TcpLink(MavlinkLink):
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
            raise ConnectionResetError("closed by the other end")
        return data

    def _send(self, data: bytes) -> None:
        self._end.settimeout(WRITE_S)
        self._end.sendall(data)  # all or a broken link: half a message would spoil the next


class SerialLink(MavlinkLink):
    """A serial line. Needs `pyserial`."""

    def __init__(self, path: str, baud: int) -> None:
        import serial  # only needed here

        super().__init__()
        self._make: Any = serial.Serial
        self._path, self._baud = path, baud

    def _opened(self) -> Any:
        return self._make(self._path, self._baud, timeout=0, write_timeout=WRITE_S)

    def _read(self, wait_s: float) -> bytes:
        if not select.select([self._end], [], [], wait_s)[0]:
            return b""
        data: bytes = self._end.read(READ_BYTES)  # raises if there is no data: the device is gone
        return data

    def _send(self, data: bytes) -> None:
        self._end.write(data)
