"""A hostile process: `python -m tests.support.stranger RUN ENDPOINT PASSWORD` puts rubbish on agent 3's keys.

It stays until its standard input ends: a session that closes may drop what it still has to send.
"""

import sys

import msgpack
import zenoh

from deltaswarm_wire.keys import ACT, RADIO, REPORT, Keys
from deltaswarm_wire.messages import Act, TreeStatus, encode_act
from deltaswarm_wire.session import RouterLink, client_pairs, configured
from tests.support.swarms import wait_until

AGENT = 3
HUGE = b"\x00" * 10_000_000

RUBBISH = {
    ACT: [
        b"",
        b"\xff" * 40,
        HUGE,
        msgpack.packb([9, 5, 0.0, 0.0, []]),
        msgpack.packb([1, 5, float("nan"), 0.0, []]),
        encode_act(Act(10**6, 0.0, 0.0, (), TreeStatus(), 10**6 + 1)),
    ],
    RADIO: [b"\xc1", HUGE, msgpack.packb([1, 1, 4, 0, float("nan"), 0]), msgpack.packb([2, 3, 3, 0, 0, 0])],
    REPORT: [b"?", HUGE, msgpack.packb({"v": 2}), msgpack.packb({"v": 7, "agent": 4})],
}


def main(run: str, endpoint: str, password: str) -> None:
    """Put everything, in order."""
    keys = Keys(run)
    link = RouterLink(endpoint, f"agent-{AGENT}", password)
    with zenoh.open(configured(zenoh.Config, client_pairs(link), link)) as session:
        for leaf, samples in RUBBISH.items():
            publisher = session.declare_publisher(
                keys.agent(AGENT, leaf), congestion_control=zenoh.CongestionControl.BLOCK
            )
            wait_until(lambda publisher=publisher: publisher.matching_status.matching, "a way to the world")
            for sample in samples:
                publisher.put(sample)
        sys.stdin.read()


if __name__ == "__main__":
    main(*sys.argv[1:])
