"""The steps of a run in real processes: launch all of them, watch them, and end them."""

import secrets
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from deltaswarm_orchestrator.live.observers import LiveObserver
from deltaswarm_orchestrator.live.views import ResearcherFeed
from deltaswarm_orchestrator.processes.boards import commands
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.processes.process import RunPart
from deltaswarm_orchestrator.processes.station import Station, announce
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.options import RunContext
from deltaswarm_orchestrator.run.watch import Watch


@dataclass
class Ending:
    """How the processes of a run ended."""

    why: list[str | RunPart] = field(default_factory=list)
    """Reasons why the run ended too early, and what was lost, one line each; an agent stands for its own line."""
    agents: Sequence[RunPart] = ()
    """The processes of agents, which have ended when the run is concluded."""
    logs: list[str] = field(default_factory=list)
    """The last lines of the logs of failed parts."""
    operator_restarts: int = 0
    disk_is_full: bool = False


@dataclass(eq=False)
class RunByProcesses:
    """One run whose parts are processes."""

    context: RunContext
    folder: Path
    checkpoint_steps: int
    resumed: Resumed | None
    live_observers: list[LiveObserver]
    ending: Ending
    """Filled in also if the run fails."""

    def execute(self, recorder: Sink | None) -> None:
        """Launch all processes, watch them, and end them.

        Raises:
            LaunchError, ConnectionError: a part did not start.
            StoppedError: the user asked to stop before all parts were up.
            RoomError: the recording could not be written.
        """
        context, folder, resumed, ending = self.context, self.folder, self.resumed, self.ending
        scenario, options, boards = context.scenario, context.options, context.options.boards
        # With boards the name must not change, because a board's file is used for later runs too.
        # Without boards it is random; the router and its port serve this run alone.
        name = scenario.name if boards else f"{scenario.name}-{secrets.token_hex(4)}"
        with Swarm(
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
        ) as swarm:
            self._start_pages(swarm, has_truth=recorder is not None)
            swarm.start_world(options.listen, record=recorder is not None)
            if boards:
                context.reporter.say(commands(boards.write(name, swarm.endpoints[-1], scenario, swarm.password)))
            with Observer(
                name,
                swarm.recorder_link(),
                recorder,
                wire=scenario.record == "wire",
                first_step=resumed.step + 1 if resumed else 0,
                checkpoint_steps=self.checkpoint_steps,
            ) as observer:
                patience_s = scenario.run.step_timeout_s
                watch = Watch(swarm, observer, context.reporter, context.stop, patience_s, self.live_observers)
                try:
                    swarm.start_operator(publish_all=recorder is not None)
                    swarm.start_agents()
                    swarm.write_pids()
                    watch.watch_to_the_end()
                finally:
                    ending.why += watch.why
                    ending.agents = swarm.agents
                    ending.logs += [
                        f"the last lines of the log of {part}:\n{tail}"
                        for part, tail in watch.logs.items()
                        if tail.strip()
                    ]
                    ending.operator_restarts = watch.operator_restarts
                    ending.disk_is_full = watch.disk_is_full

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
            page, scenario = Station(), self.context.scenario
            feed = ResearcherFeed(page.operators_end, swarm.run, scenario, is_beside_operator=station is not None)
            self.live_observers.append(feed)
            urls["researcher_url"] = swarm.start_station(page, 1)
            swarm.conductor = page if station else None
            say(f"conductor's page, which shows the truth: {urls['researcher_url']}")
        if station:
            announce(self.folder, urls, opens_browser=station.opens_browser)
