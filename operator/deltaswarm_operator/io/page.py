"""The station's process as a child of the operator in open air."""

import os
import select
import socket
import subprocess
import sys
import time
from contextlib import suppress
from typing import Self

from deltaswarm_wire.child import READY_VARIABLE

READY_WITHIN_S = 60.0
ENDS_WITHIN_S = 3.0


class Page:
    """The station's process. However the operator ends, the station ends too, because its feed closes."""

    def __init__(self, listen: str) -> None:
        self.end, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-P", "-m", "deltaswarm_operator.station", "--listen", listen]
        reader, writer = os.pipe()
        with theirs:
            self._process = subprocess.Popen(
                [*command, "--channel-fd", str(theirs.fileno())],
                pass_fds=[theirs.fileno(), writer],
                env={**os.environ, READY_VARIABLE: str(writer)},
            )
        os.close(writer)
        try:
            self.url = self._first_line(reader)
        except BaseException:
            self.close()
            raise
        finally:
            os.close(reader)

    @staticmethod
    def _first_line(stdout: int) -> str:
        line, deadline = b"", time.monotonic() + READY_WITHIN_S
        while not line.endswith(b"\n"):
            left_s = deadline - time.monotonic()
            more = os.read(stdout, 4096) if left_s > 0 and select.select([stdout], [], [], left_s)[0] else b""
            if not more:
                raise OSError("the station did not start; see its message above")
            line += more
        return line.decode().strip()

    def close(self) -> None:
        """Close the channel, at which the process tells its pages of the end and ends; one that does not is killed."""
        with suppress(OSError):  # there may be no other end any more
            self.end.shutdown(socket.SHUT_RDWR)  # a thread may be reading
        self.end.close()
        for stop in (self._process.poll, self._process.terminate, self._process.kill):
            stop()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(ENDS_WITHIN_S)
                return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
