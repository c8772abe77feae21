"""Notifications to systemd (sd_notify): datagrams to the socket that the environment names."""

import contextlib
import os
import socket
from collections.abc import MutableMapping
from typing import Self


class Notifier:
    """A watched service's side of systemd's protocol; without a socket it does nothing."""

    def __init__(self, address: str = "", alive_every_s: float | None = None) -> None:
        self.alive_every_s = alive_every_s
        """Longest interval between calls of `alive` [s]; None: no watchdog."""
        # Linux spells its abstract socket names with a leading NUL, the environment with an @.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if address else None

    @classmethod
    def from_environment(cls, environment: MutableMapping[str, str] = os.environ) -> Self:
        """Read NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID; use half the watchdog's time, as systemd advises."""
        text, pid = environment.get("WATCHDOG_USEC", ""), environment.get("WATCHDOG_PID", "")
        is_watched = text.isdecimal() and int(text) > 0 and pid in ("", str(os.getpid()))
        return cls(environment.get("NOTIFY_SOCKET", ""), int(text) / 2e6 if is_watched else None)

    def ready(self) -> None:
        """Notify that the first step is complete."""
        self._send("READY=1")

    def alive(self) -> None:
        """Notify the watchdog that the process lives."""
        if self.alive_every_s is not None:
            self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Set the line in `systemctl status`."""
        self._send(f"STATUS={text}")

    def stopping(self) -> None:
        """Notify that the process is ending."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Close the socket."""
        if self._socket:
            self._socket.close()

    def _send(self, text: str) -> None:
        if self._socket:
            with contextlib.suppress(OSError):  # systemd is busy or gone: no reason for an agent to stop
                self._socket.sendto(text.encode(), self._address)
