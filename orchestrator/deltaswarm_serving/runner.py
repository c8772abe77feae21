"""Does the session of one participant whose pages another process serves, in one process.

Every input is written down, so that after a kill the session goes on at the same step.
"""

import json
import os
import queue
import shutil
import socket
from dataclasses import dataclass, field, replace

from deltaswarm_operator.io.asking import ask
from deltaswarm_operator.io.console_server import Channel
from deltaswarm_orchestrator.base.exits import FAILED, notice
from deltaswarm_orchestrator.run.at_station import Arrivals, Seat
from deltaswarm_orchestrator.run.journal import Header, Journal
from deltaswarm_orchestrator.run.operating import briefing_of
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_scenario.person_tables import CONDUCTOR, PERSON
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.techniques import ProbeSettings
from deltaswarm_serving.unfinished import Left, identity_of, journal_of, left
from deltaswarm_sessions.folder import folders_of_later_answers
from deltaswarm_sessions.plan import PlannedRun, after_score
from deltaswarm_sessions.runner import Runner
from deltaswarm_sessions.session import SCORE, Ask


@dataclass(kw_only=True)
class HostedRunner(Runner):
    """Does a session whose pages are served elsewhere."""

    ends: tuple[socket.socket, socket.socket]
    """Of the channels to the participant's and the conductor's page."""
    has_agreed: bool = True
    """Whether the person agreed at a door; else the page of the first run asks."""
    markers: str = ""
    """Where the person's acts are told: HOST:PORT or "lsl"; empty: nowhere."""
    _arrivals: Arrivals = field(default_factory=queue.SimpleQueue, init=False)
    _asked: "queue.SimpleQueue[bytes | None]" = field(default_factory=queue.SimpleQueue, init=False)
    """Inputs while questions are asked after a run."""
    _is_asking: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        person, conductor = self.ends
        self._channel = Channel(person, lambda data: self._take(PERSON, data))
        self._conductor = Channel(conductor, lambda data: self._take(CONDUCTOR, data))

    def _put_aside(self) -> None:
        """Put aside what was killed and can go on: it is no attempt of its own."""
        for run in self.session.runs:
            if (found := self._left(run)) is not None:
                shutil.rmtree(self.folder / f"{found[0].run}.part", ignore_errors=True)

    def _take(self, by: str, data: bytes | None) -> None:
        """Take an input; None: who serves the pages has gone, and a later process goes on from the journal."""
        if data is None:
            os._exit(FAILED)
        if self._is_asking:
            self._asked.put(data)
        else:
            self._arrivals.put((by, data))

    def _ready(self, run: PlannedRun) -> RunOptions:
        options, found = self._options(run), self._left(run)
        name = found[0].run if found else options.out.name
        header, rows = found or (Header.now(name, self._identity(run)), ())
        while found is None and not self._arrivals.empty():  # what belongs to the run before
            self._arrivals.get()
        seat = Seat(
            f"{self.folder.name}/{name}",
            self._channel,
            self._arrivals,
            self.speed,
            conductor=self._conductor,
            journal=Journal(journal_of(self.folder, run), header, rows),
            markers=self.markers,
            sheet=agreed(run.scenario.operator.probes) if self.has_agreed else None,
        )
        return replace(options, out=self.folder / name, seat=seat)

    def _do_run(self, run: PlannedRun) -> int:
        code = super()._do_run(run)
        journal_of(self.folder, run).unlink()
        return code

    def _ask(self, step: Ask) -> None:
        folder, scenario = self.folder / step.attempt.folder, step.attempt.scenario
        name = f"again-{len(folders_of_later_answers(folder)) + 1}" if step.text else SCORE
        out = folder.with_name(f"{folder.name}.{name}")
        out.mkdir(exist_ok=not step.text)
        asked: Scenario = after_score(replace(scenario, operator=replace(scenario.operator, probes=step.probes)))
        self._is_asking = True
        try:
            ask(briefing_of(asked), out, self._channel, self._asked)
        finally:
            self._is_asking = False

    def _left(self, run: PlannedRun) -> Left | None:
        """Return what is left of a run that was cut off and can go on; remove what cannot."""
        found = left(self.folder, run)
        if found is not None and found[0].identity != self._identity(run):
            notice(f"{found[0].run} was begun by other code or files, so it is done again")
            journal_of(self.folder, run).unlink()
            return None
        return found

    def _identity(self, run: PlannedRun) -> str:
        return identity_of(run, self._inputs[run.folder], self.speed)


def agreed(probes: ProbeSettings) -> bytes | None:
    """Return the sheet of a person who agreed at the door; None: the run asks for no consent."""
    if not probes.consent:
        return None
    filled = {"consent": True, "participant": probes.participant, "condition": probes.condition}
    return json.dumps({"type": "sheet", "id": "agreed-before", "from": 0, **filled}).encode()
