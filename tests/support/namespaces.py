"""Machines for tests: network namespaces with addresses of their own, joined by a bridge, whose links may be bad.

Everything is in namespaces that are made here, the bridge too; the machine's own network is not touched. Where the
kernel has no netem, the test's own process stands in for it: each machine's link is then a pair of taps, and what the
machine sends is held back or lost between them, Ethernet frame by Ethernet frame.
"""

import contextlib
import fcntl
import heapq
import os
import select
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from itertools import count
from pathlib import Path
from random import Random

import pytest

PREFIX = "ds77"
"""Namespaces are called PREFIX-PROCESS-NUMBER."""

HUB = "hub"
CAPABILITIES = {"CAP_NET_ADMIN": 12, "CAP_SYS_ADMIN": 21}
TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
LARGEST_FRAME = 65_536

_numbers = count()


def run(*command: str) -> str:
    """A command that must succeed; what it prints."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stderr}"
    return done.stdout


@cache
def why_not() -> str:
    """Why there can be no namespaces here; empty if there can."""
    if shutil.which("ip") is None:
        return "no program `ip` (iproute2)"
    effective = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("CapEff"))
    held = int(effective.split()[1], 16)
    if missing := [name for name, bit in CAPABILITIES.items() if not held >> bit & 1]:
        return f"no {' and '.join(missing)}: be root"
    try:
        with network(1):
            return ""
    except AssertionError as error:
        return f"namespaces, bridges and veth pairs cannot be made: {error}"


def has_netem(namespace: str) -> bool:
    """Whether the kernel can make a link bad by itself."""
    if shutil.which("tc") is None:
        return False
    command = ["tc", "-n", namespace, "qdisc", "add", "dev", "lo", "root", "netem", "delay", "0ms"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


class BadWire(threading.Thread):
    """Carries frames between taps; those that come from a machine late or not at all."""

    def __init__(self, pairs: list[tuple[int, int]], delay_s: float, loss: float) -> None:
        super().__init__(name="bad wire", daemon=True)
        self._far = dict(pairs) | {far: near for near, far in pairs}
        self._bad = {near for near, _ in pairs}
        self._delay_s, self._loss = delay_s, loss
        self._rng = Random(1)
        self._closed, self._close = os.pipe()
        self.carried = self.lost = 0

    def run(self) -> None:
        """Until closed."""
        order = count()
        held: list[tuple[float, int, int, bytes]] = []
        while True:
            wait_s = max(0.0, held[0][0] - time.monotonic()) if held else None
            ready, _, _ = select.select([*self._far, self._closed], [], [], wait_s)
            if self._closed in ready:
                return
            for end in ready:
                with contextlib.suppress(OSError):  # a link that is down
                    frame = os.read(end, LARGEST_FRAME)
                    if end in self._bad and self._rng.random() < self._loss:
                        self.lost += 1
                        continue
                    self.carried += 1
                    due_s = time.monotonic() + (self._delay_s if end in self._bad else 0.0)
                    heapq.heappush(held, (due_s, next(order), self._far[end], frame))
            while held and held[0][0] <= time.monotonic():
                _, _, end, frame = heapq.heappop(held)
                with contextlib.suppress(OSError):
                    os.write(end, frame)

    def close(self) -> None:
        """End, and let go of the taps."""
        os.write(self._close, b"x")
        if self.is_alive():
            self.join()
        for end in (*self._far, self._close, self._closed):
            os.close(end)


class Network:
    """Machines 0 to n-1 at 10.77.K.1 and up, and the hub at 10.77.K.254, where the bridge is."""

    def __init__(self) -> None:
        number = next(_numbers)
        self._subnet = f"10.77.{number % 256}"
        self._name = f"{PREFIX}-{os.getpid()}-{number}"
        self._wire: BadWire | None = None
        self.made_by = ""
        """What delays and loses: nothing, netem, or the test's own process."""

    def build(self, machines: int, delay_s: float, loss: float) -> None:
        """Make everything."""
        hub = self.namespace(HUB)
        run("ip", "netns", "add", hub)
        run("ip", "-n", hub, "link", "set", "lo", "up")
        run("ip", "-n", hub, "link", "add", "br0", "type", "bridge")
        run("ip", "-n", hub, "address", "add", f"{self.address(HUB)}/24", "dev", "br0")
        run("ip", "-n", hub, "link", "set", "br0", "up")
        is_bad = bool(delay_s or loss)
        self.made_by = ("netem" if has_netem(hub) else "own process") if is_bad else ""
        taps = []
        for machine in range(machines):
            space = self.namespace(machine)
            run("ip", "netns", "add", space)
            if self.made_by == "own process":
                taps.append((tap(space, "eth0"), tap(hub, f"p{machine}")))
            else:
                peer = ("peer", "name", "eth0", "netns", space)
                run("ip", "-n", hub, "link", "add", f"p{machine}", "type", "veth", *peer)
            run("ip", "-n", hub, "link", "set", f"p{machine}", "master", "br0", "up")
            run("ip", "-n", space, "link", "set", "lo", "up")
            run("ip", "-n", space, "address", "add", f"{self.address(machine)}/24", "dev", "eth0")
            run("ip", "-n", space, "link", "set", "eth0", "up")
            if self.made_by == "netem":
                bad = ["delay", f"{delay_s * 1000:g}ms", "loss", f"{loss:%}"]
                run("tc", "-n", space, "qdisc", "add", "dev", "eth0", "root", "netem", *bad)
        if taps:
            self._wire = BadWire(taps, delay_s, loss)
            self._wire.start()

    def remove(self) -> None:
        """Whatever of it there is."""
        if self._wire:
            self._wire.close()
        for name in names():
            if name.startswith(f"{self._name}-"):
                run("ip", "netns", "delete", name)

    def namespace(self, machine: int | str) -> str:
        """Its name."""
        return f"{self._name}-{machine}"

    def address(self, machine: int | str) -> str:
        """A machine's, or the hub's."""
        return f"{self._subnet}.{254 if machine == HUB else int(machine) + 1}"

    def inside(self, machine: int | str) -> list[str]:
        """The command that runs another one there, as the same process."""
        return ["ip", "netns", "exec", self.namespace(machine)]

    def cut(self, machine: int) -> None:
        """Its link goes down, for everybody; connections stay as they were."""
        run("ip", "-n", self.namespace(HUB), "link", "set", f"p{machine}", "down")

    def mend(self, machine: int) -> None:
        """Its link comes back."""
        run("ip", "-n", self.namespace(HUB), "link", "set", f"p{machine}", "up")


def tap(namespace: str, name: str) -> int:
    """A network interface in a namespace whose cable is a file descriptor here."""
    end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    made = f"{PREFIX}t{os.getpid() % 10**7}"
    fcntl.ioctl(end, TUNSETIFF, struct.pack("16sH22x", made.encode(), IFF_TAP | IFF_NO_PI))
    run("ip", "link", "set", made, "netns", namespace, "name", name)
    return end


def names() -> list[str]:
    """All namespaces that tests made."""
    found = [line.split()[0] for line in run("ip", "netns", "list").splitlines() if line]
    return [name for name in found if name.startswith(f"{PREFIX}-")]


def remove_stale() -> None:
    """Namespaces of test processes that are gone, and what still runs in them."""
    for name in names():
        if not Path(f"/proc/{name.split('-')[1]}").exists():
            for pid in run("ip", "netns", "pids", name).split():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(int(pid), 9)
            run("ip", "netns", "delete", name)


@contextmanager
def network(machines: int, delay_s: float = 0.0, loss: float = 0.0) -> Iterator[Network]:
    """One that is gone afterwards; what a machine sends comes so much later [s], or with this probability not."""
    remove_stale()
    made = Network()
    try:
        made.build(machines, delay_s, loss)
        yield made
    finally:
        made.remove()


NEEDS_NAMESPACES = [
    pytest.mark.slow,
    pytest.mark.processes,
    pytest.mark.timeout(900),
    pytest.mark.skipif(bool(why_not()), reason=f"no network namespaces here: {why_not()}"),
]
