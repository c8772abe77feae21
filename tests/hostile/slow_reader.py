"""`python -m tests.hostile.slow_reader`: a client that subscribes, takes one sample and never reads again."""

import os
import signal
import sys
import threading

from deltaswarm_wire.session import RouterLink, client_pairs, configured

UNREAD = (("transport/link/tx/lease", "86400000"), ("transport/link/tcp/so_rcvbuf", "4096"))
"""Nobody cuts it off for its silence, and few bytes suffice to fill its buffer."""


def main(endpoint: str, user: str, password: str, key: str, link: str) -> None:
    """Stop in the middle of reading, as SIGSTOP from outside would; `link` is `low-latency` or `ordinary`.

    A line is printed once the subscription is on its way.
    """
    import zenoh

    router = RouterLink(endpoint, user, password, low_latency=link == "low-latency", overrides=UNREAD)
    heard = threading.Event()
    with zenoh.open(configured(zenoh.Config, client_pairs(router), router)) as session:
        session.declare_subscriber(key, lambda _: heard.set())
        print("there", flush=True)
        heard.wait()
        os.kill(os.getpid(), signal.SIGSTOP)


if __name__ == "__main__":
    main(*sys.argv[1:])
