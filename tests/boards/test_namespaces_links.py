"""The links of the machines that other tests are made of: as late and as lossy as they are told to be."""

import json
import subprocess
import sys
from statistics import median

import pytest

from tests.support import namespaces
from tests.support.namespaces import HUB, NEEDS_NAMESPACES, network

pytestmark = NEEDS_NAMESPACES

DELAY_S, LOSS = 0.05, 0.2
SENT = 500

RECEIVE = """
import json, socket, sys, time
receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
receiver.bind((sys.argv[1], 7777))
print("ready", flush=True)
delays_s = []
receiver.settimeout(30)
try:
    while True:
        sent_s = float(receiver.recv(100))
        delays_s.append(time.monotonic() - sent_s)
        receiver.settimeout(3)
except TimeoutError:
    print(json.dumps(delays_s))
"""

SEND = """
import socket, sys, time
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for _ in range(int(sys.argv[2])):
    sender.sendto(repr(time.monotonic()).encode(), (sys.argv[1], 7777))
    time.sleep(0.002)
"""


@pytest.mark.parametrize("made_by", ["netem", "own process"])
def test_a_link_is_as_bad_as_it_is_told_to_be(made_by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the kernel's netem and by what stands in for it alike; loss within five standard deviations."""
    if made_by == "own process":
        monkeypatch.setattr(namespaces, "has_netem", lambda namespace: False)
    with network(1, DELAY_S, LOSS) as net:
        if net.made_by != made_by:
            pytest.skip("this kernel has no netem")
        python = [sys.executable, "-c"]
        hub = net.address(HUB)
        receiver = subprocess.Popen([*net.inside(HUB), *python, RECEIVE, hub], stdout=subprocess.PIPE, text=True)
        with receiver:
            try:
                assert receiver.stdout is not None
                assert receiver.stdout.readline() == "ready\n"
                subprocess.run([*net.inside(0), *python, SEND, hub, str(SENT)], check=True)
                delays_s = json.loads(receiver.stdout.readline())
            finally:
                receiver.kill()
    assert min(delays_s) >= DELAY_S - 0.001
    assert median(delays_s) < 2 * DELAY_S
    assert len(delays_s) / SENT == pytest.approx(1 - LOSS, abs=0.09)
