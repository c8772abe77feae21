"""Serve a page that belongs to no run in progress: a process that feeds it and its station, which end with this one."""

import socket
from collections.abc import Callable
from pathlib import Path

from deltaswarm_orchestrator.processes.process import wait_for
from deltaswarm_orchestrator.processes.starter import LaunchError, Options, Starter
from deltaswarm_orchestrator.processes.station import STATION, StationChannel

START_WITHIN_S = 60.0
LOOK_EVERY_S = 0.2


def serve_page(
    feed: str,
    options: Options,
    logs: Path,
    station: StationChannel,
    say_url: Callable[[str], None],
    *,
    was_stopped: Callable[[], object] = lambda: None,
) -> None:
    """Serve the page of a feed until the feed ends, or `was_stopped` returns something true.

    The feed has the role `feed` and these options. The folder `logs` is created; the station's two ends are closed.
    `say_url` gets the page's URL once browsers can connect.

    Raises:
        LaunchError: a process did not start, or the feed failed; the text has its last log lines.
        StoppedError: the user asked to stop before the page was there.
    """
    logs.mkdir()
    starter = Starter(logs, "", START_WITHIN_S, was_stopped)
    try:
        to_station: dict[str, socket.socket] = {"--channel-fd": station.stations_end}
        say_url(
            starter.start_and_read(
                STATION, 0, {"--listen": station.listen}, password=station.token, channels=to_station
            )
        )
        part = starter.start(feed, 0, options, channels={"--channel-fd": station.operators_end})
        station.close()  # each process notices the end of the other one
        while wait_for([part], LOOK_EVERY_S):
            if was_stopped():
                return
        if part.has_failed:
            raise LaunchError(part.how_it_ended(), part.log_tail())
    finally:
        starter.end()
        station.close()
