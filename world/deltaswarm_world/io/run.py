"""A whole run of the world: its router, its process, and its files."""

import logging
import signal
from collections.abc import Callable

from deltaswarm_wire.keys import Keys
from deltaswarm_world.io.config import WorldConfig
from deltaswarm_world.io.files import WorldOutput
from deltaswarm_world.io.process import WorldProcess
from deltaswarm_world.io.saving import SavedWorld
from deltaswarm_world.io.slow_links import SlowLinks, trusted_sessions
from deltaswarm_world.io.transport import Transport, open_router
from deltaswarm_world.io.wakeup import Wakeup

log = logging.getLogger("deltaswarm.world")

STOP_SIGNALS = {signal.SIGTERM, signal.SIGINT}


def run_world(config: WorldConfig, announce: Callable[[str], None], saved: SavedWorld | None = None) -> int:
    """Run the router and the world of one run; return the exit code.

    `announce` gets the endpoints, separated by spaces, once the router listens on them. With `saved` the world resumes.
    """
    early: list[int] = []
    for number in STOP_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda number, _: early.append(number))
    saved = saved or SavedWorld.new(config)
    keys, agents = Keys(config.run), range(config.scenario.agents.count)
    trusted = trusted_sessions(config.credentials.read_text(encoding="utf-8"))
    asked = config.listen or (config.link.endpoint,)
    with WorldOutput(config.out, saved.core.columns, saved.table_bytes, saved.wall_s) as output:
        session, endpoints = open_router(config.link, str(config.credentials), keys, agents, asked)
        with session:
            wakeup, transport = Wakeup(session, keys), Transport(session, keys, len(agents))
            slow_links = SlowLinks(session, trusted, transport.waits_for)
            announce(" ".join(endpoints))  # from here on they come
            if early:  # the signal came before the wakeup was ready
                signal.raise_signal(early[0])
            try:
                world = WorldProcess(config, transport, wakeup, saved)
                world.wait_for_all()
                complete = world.run(output)
                world.goodbye()
            except (TimeoutError, InterruptedError) as error:
                log.error("the run ends: %s", error)
                complete = False
            finally:
                transport.close()
                wakeup.close()
                slow_links.close()
    return 0 if complete else 1
