"""The steps of a run in real processes: launch all of them, watch them, and end them."""

import secrets
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from deltaswarm_orchestrator.base import disk
from deltaswarm_orchestrator.live.observers import LiveObserver
from deltaswarm_orchestrator.live.views import ResearcherFeed
from deltaswarm_orchestrator.processes.boards import commands
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.processes.process import RunPart, wait_for
from deltaswarm_orchestrator.processes.starter import BEFORE_READY, LaunchError
from deltaswarm_orchestrator.processes.station import StationChannel, announce
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.options import RunContext
from deltaswarm_orchestrator.run.watch import Watch
from deltaswarm_wire.plugin_errors import distinct
from deltaswarm_wire.session import closing

END_KNOWN_WITHIN_S = 0.5
"""Maximum wait for the exit code of a part whose end may be why another one did not start [s]."""


@dataclass
class Ending:
    """How the processes of a run ended."""

    why: list[str | RunPart] = field(default_factory=list)
    """Reasons why the run ended too early, and what was lost, one line each, in the order in which they happened; an
    agent stands for its own line."""
    cause: str | RunPart | None = None
    """That of `why` for which the run ended; None if it did not end too early, or the user ended it."""
    when: str = "before the first step"
    """Where the run was when its steps ended."""
    agents: Sequence[RunPart] = ()
    """The processes of agents, which have ended when the run is concluded."""
    logs: list[str] = field(default_factory=list)
    """The last lines of the logs of failed parts, and tracebacks."""
    operator_restarts: int = 0
    disk_is_full: bool = False

    def fail(self, reason: str) -> None:
        """Note what went wrong; the run ends for it unless it ends for something earlier."""
        self.why.append(reason)
        self.cause = self.cause or reason


@dataclass(eq=False)
class RunByProcesses:
    """One run whose parts are processes."""

    context: RunContext
    folder: Path
    is_folder_there: Callable[[], bool]
    checkpoint_steps: int
    resumed: Resumed | None
    live_observers: list[LiveObserver]
    ending: Ending
    """Filled in also if the run fails."""

    def execute(self, recorder: Sink | None) -> None:
        """Launch all processes, watch them, and end them.

        Raises:
            StoppedError: the user asked to stop before all parts were up.
            RoomError: the recording could not be written.
        """
        context, folder, resumed, ending = self.context, self.folder, self.resumed, self.ending
        scenario, options, boards = context.scenario, context.options, context.options.boards
        # With boards the name must not change, because a board's file is used for later runs too.
        # Without boards it is random; the router and its port serve this run alone.
        name = scenario.name if boards else f"{scenario.name}-{secrets.token_hex(4)}"
        with (
            ExitStack() as links,
            Swarm(
                scenario,
                name,
                folder,
                zenoh=options.zenoh,
                boards=boards,
                remote=context.placement.agents(scenario, folder / "logs") if context.placement else None,
                was_stopped=lambda: context.stop.by,
                checkpoint_steps=self.checkpoint_steps,
                resumed=resumed,
                station=options.station,
            ) as swarm,
        ):
            try:
                self._start_pages(swarm, has_truth=recorder is not None)
                swarm.start_world(options.listen, record=recorder is not None)
                if boards:
                    context.reporter.say(commands(boards.write(name, swarm.endpoints[-1], scenario, swarm.password)))
                # Its link is closed when the parts have ended: nothing can be sent to a world that is stopped.
                observer = Observer(
                    name,
                    swarm.recorder_link(),
                    recorder,
                    wire=scenario.record == "wire",
                    first_step=resumed.step + 1 if resumed else 0,
                    checkpoint_steps=self.checkpoint_steps,
                )
                links.enter_context(closing(observer, ending.why.append))
                swarm.start_operator(publish_all=recorder is not None)
                swarm.start_agents()
                swarm.write_pids()
            except (LaunchError, ConnectionError) as error:
                self._note_failed_start(swarm, error)
                return
            watch = Watch(
                swarm,
                observer,
                context.reporter,
                context.stop,
                scenario.run.step_timeout_s,
                self.live_observers,
                self.is_folder_there,
            )
            try:
                watch.watch_to_the_end()
            except BaseException:
                observer.leave()
                raise
            finally:
                ending.why += watch.why
                ending.cause, ending.when = watch.cause, watch.when
                ending.agents = swarm.agents
                ending.logs += told(watch.logs, watch.traces)
                ending.operator_restarts = watch.operator_restarts
                ending.disk_is_full = watch.disk_is_full

    def _note_failed_start(self, swarm: Swarm, error: LaunchError | ConnectionError) -> None:
        """Note why a part did not start: first those that have ended, without which others could not."""
        disk.check_spare(self.folder)  # a part cannot log that the disk is full
        reason = str(error)
        if isinstance(error, LaunchError):
            reason = error.reason
            self.ending.logs += [f"its log:\n{error.log}"] if error.log else []
        wait_for(swarm.parts[:1], END_KNOWN_WITHIN_S)
        logs: dict[str, str] = {}
        traces: dict[str, str] = {}
        for part in swarm.ended():
            if part.has_failed and (line := part.how_it_ended(BEFORE_READY)) != reason:
                self.ending.fail(line)
                logs[part.name], traces[part.name] = part.log_tail(), part.trace
        self.ending.logs += told(logs, traces)
        self.ending.fail(reason)

    def _start_pages(self, swarm: Swarm, *, has_truth: bool) -> None:
        """Start the pages of the person and of the researcher, if the run has them, and say where they are.

        Raises:
            LaunchError, StoppedError: as in `execute`.
        """
        options, say = self.context.options, self.context.reporter.say
        station, urls = options.station, {}
        if station:
            urls = {"url": swarm.start_station(), "watch_url": station.watch_url}
            say(f"station: {urls['url']}")
            say(f"only to watch it: {station.watch_url}")
        if options.researcher and has_truth:
            page, scenario = options.researcher_page or StationChannel(), self.context.scenario
            feed = ResearcherFeed(page.operators_end, swarm.run, scenario, is_beside_operator=station is not None)
            self.live_observers.append(feed)
            urls["researcher_url"] = swarm.start_station(page, 1)
            swarm.conductor = page if station else None
            say(f"conductor's page, which shows the truth: {urls['researcher_url']}")
        if station:
            announce(self.folder, urls, opens_browser=station.opens_browser)


def told(logs: Mapping[str, str], traces: Mapping[str, str]) -> list[str]:
    """Return what the logs of failed parts say: each traceback once, of others the last lines.

    Args:
        logs: the last lines of each part's log.
        traces: the traceback of each part, empty where there is none.
    """
    shown = [
        f"the traceback of {parts[0]}" + (f" and {len(parts) - 1} other parts" if parts[1:] else "") + f":\n{trace}"
        for trace, parts in distinct({part: trace for part, trace in traces.items() if trace}).items()
    ]
    tails = {part: tail for part, tail in logs.items() if tail and not traces.get(part)}
    return shown + [f"the last lines of the log of {part}:\n{tail}" for part, tail in tails.items()]
