"""A session whose agents are processes: what its operator's process shows and takes is passed on to the pages."""

import socket
import threading
from contextlib import suppress
from dataclasses import dataclass, field, replace

from deltaswarm_operator.io.console_server import Channel
from deltaswarm_orchestrator.processes.station import StationChannel
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_scenario.page_messages import MAX_DATAGRAM_BYTES
from deltaswarm_scenario.person_tables import CONDUCTOR, PERSON
from deltaswarm_serving.runner import HostedRunner, agreed
from deltaswarm_sessions.plan import PlannedRun
from deltaswarm_sessions.runner import Runner


@dataclass(kw_only=True)
class RelayedRunner(HostedRunner):
    """Does each run by processes; one that is killed is an attempt, and is done again."""

    _stations: dict[str, StationChannel] = field(default_factory=dict, init=False)
    """Of the run under way, by whose page it is."""

    def _take(self, by: str, data: bytes | None) -> None:
        station = self._stations.get(by)
        if data is None or self._is_asking or station is None:
            super()._take(by, data)
        else:
            with suppress(OSError):  # as a station that is behind
                station.stations_end.send(data, socket.MSG_DONTWAIT)

    def _ready(self, run: PlannedRun) -> RunOptions:
        sheet = agreed(run.scenario.operator.probes) if self.has_agreed else None
        self._stations = {}
        for by, channel, first in ((PERSON, self._channel, sheet), (CONDUCTOR, self._conductor, None)):
            self._stations[by] = station = StationChannel(self.speed, markers=self.markers, is_elsewhere=True)
            threading.Thread(target=_pass_on, args=(station.stations_end, channel, first), daemon=True).start()
        station, conductor = self._stations[PERSON], self._stations[CONDUCTOR]
        return replace(self._options(run), in_process=False, station=station, conductor=conductor)

    def _do_run(self, run: PlannedRun) -> int:
        try:
            return Runner._do_run(self, run)
        finally:
            self._stations = {}


def _pass_on(end: socket.socket, channel: Channel, first: bytes | None) -> None:
    """Pass on what an operator shows until it has gone, and tell it `first` once it shows something."""
    while True:
        try:
            data = end.recv(MAX_DATAGRAM_BYTES)
            if data and first is not None:
                end.send(first)
                first = None
        except OSError:
            return
        if not data:
            return
        channel.pass_on(data)
