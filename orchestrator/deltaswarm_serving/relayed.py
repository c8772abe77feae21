"""A session whose agents are processes: what its operator's process shows and takes is passed on to the pages."""

import secrets
import socket
import threading
from contextlib import suppress
from dataclasses import dataclass, field, replace

from deltaswarm_operator.io.console_server import Channel
from deltaswarm_orchestrator.processes.station import LOOPBACK, StationChannel, free_address
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_scenario.page_messages import MAX_DATAGRAM_BYTES, made
from deltaswarm_scenario.person_tables import CONDUCTOR, PERSON
from deltaswarm_serving.runner import HostedRunner, agreed
from deltaswarm_serving.unfinished import journal_of
from deltaswarm_sessions.plan import PlannedRun
from deltaswarm_sessions.runner import Runner


@dataclass(kw_only=True)
class RelayedRunner(HostedRunner):
    """Does each run by processes; one that is killed is an attempt, and is done again."""

    researcher: bool = False
    """Whether the conductor's page is one that shows the truth, at an address of its own."""
    _researcher_at: tuple[str, str] = field(init=False)
    """Its HOST:PORT and token, which stay through the session."""
    _stations: dict[str, StationChannel] = field(default_factory=dict, init=False)
    """Of the run under way, by whose page it is."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._researcher_at = free_address(LOOPBACK), secrets.token_urlsafe(24)

    def _put_aside(self) -> None:
        """Forget what a session in one process could have gone on with: here it is an attempt that was cut off."""
        for run in self.session.runs:
            journal_of(self.folder, run).unlink(missing_ok=True)

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
        options = replace(self._options(run), station=station, conductor=conductor)
        if self.researcher:
            listen, token = self._researcher_at
            page = StationChannel(listen=listen, token=token)
            options = replace(options, researcher=True, researcher_page=page)
        return options

    def _do_run(self, run: PlannedRun) -> int:
        try:
            return Runner._do_run(self, run)
        finally:
            self._stations = {}


def _pass_on(end: socket.socket, channel: Channel, first: bytes | None) -> None:
    """Pass on what an operator shows until its run is over, and tell it `first` once it shows something."""
    with suppress(OSError):
        while data := end.recv(MAX_DATAGRAM_BYTES):
            if first is not None:
                end.send(first)
                first = None
            channel.pass_on(data)
    channel.send(made("ended"))
