"""Floods keys: `python -m tests.support.flooder ENDPOINT KEY...` puts on each what standard input has, until that ends.

Its lines are samples as hex, each with its attachment behind a blank, put round and round as fast as the link takes
them. A process of its own, since a test that floods would hold up its own threads.
"""

import sys
import threading

import zenoh


def main(endpoint: str, *keys: str) -> None:
    """Read the lines up to an empty one, then flood."""
    config = zenoh.Config()
    for key, value in (
        ("mode", '"peer"'),
        ("connect/endpoints", f'["{endpoint}"]'),
        ("listen/endpoints", "[]"),
        ("scouting/multicast/enabled", "false"),
        ("transport/shared_memory/enabled", "false"),
    ):
        config.insert_json5(key, value)
    samples = []
    while line := sys.stdin.readline().split():
        samples.append([bytes.fromhex(part) for part in line])
    is_over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), is_over.set()), daemon=True).start()
    with zenoh.open(config) as session:
        block = zenoh.CongestionControl.BLOCK
        publishers = [session.declare_publisher(key, congestion_control=block) for key in keys]
        while not is_over.is_set():
            for publisher in publishers:
                for data, attachment in samples:
                    publisher.put(data, attachment=attachment)


if __name__ == "__main__":
    main(*sys.argv[1:])
