"""The engine of real processes: launch all parts of a run, watch them, and end them."""

import secrets
from contextlib import ExitStack

from deltaswarm_orchestrator.base import disk
from deltaswarm_orchestrator.live.views import ResearcherFeed
from deltaswarm_orchestrator.processes.boards import commands
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.processes.process import wait_for
from deltaswarm_orchestrator.processes.starter import BEFORE_READY, LaunchError
from deltaswarm_orchestrator.processes.station import StationChannel, announce
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.options import RunContext
from deltaswarm_orchestrator.run.watch import Watch
from deltaswarm_wire.session import closing

END_KNOWN_WITHIN_S = 0.5
"""Maximum wait for the exit code of a part whose end may be why another one did not start [s]."""


def run_by_processes(context: RunContext, recorder: Sink | None) -> None:
    """Do a run, or the rest of one that is resumed; the context's `ending` tells how it went, also if this raises.

    Raises:
        StoppedError: the user asked to stop before all parts were up.
        RoomError: the recording could not be written.
    """
    scenario, options, resumed = context.scenario, context.options, context.resumed
    folder, boards = context.folder.path, context.options.boards
    # With boards the name must not change, because a board's file is used for later runs too.
    # Without boards it is random; the router and its port serve this run alone.
    name = scenario.name if boards else f"{scenario.name}-{secrets.token_hex(4)}"
    with ExitStack() as stack:
        links = stack.enter_context(ExitStack())  # closed when the parts have ended: the world may be stopped
        swarm = stack.enter_context(
            Swarm(
                scenario,
                name,
                folder,
                zenoh=options.zenoh,
                boards=boards,
                remote=context.placement.agents(scenario, folder / "logs") if context.placement else None,
                was_stopped=lambda: context.stop.by,
                checkpoint_steps=context.checkpoint_steps,
                resumed=resumed,
                station=options.station,
            )
        )
        try:
            _start_pages(context, swarm, has_truth=recorder is not None)
            swarm.start_world(options.listen, record=recorder is not None)
            if boards:
                context.reporter.say(commands(boards.write(name, swarm.endpoints[-1], scenario, swarm.password)))
            observer = Observer(
                name,
                swarm.recorder_link(),
                recorder,
                wire=scenario.record == "wire",
                first_step=resumed.step + 1 if resumed else 0,
                checkpoint_steps=context.checkpoint_steps,
            )
            links.enter_context(closing(observer, context.ending.why.append))
            swarm.start_operator(publish_all=recorder is not None)
            swarm.start_agents()
            swarm.write_pids()
        except (LaunchError, ConnectionError) as error:
            _note_failed_start(context, swarm, error)
            return
        watch = Watch(context, swarm, observer)
        try:
            watch.watch_to_the_end()
        except BaseException:
            observer.leave()
            raise
        finally:
            context.ending.when, context.ending.agents = watch.when, swarm.agents


def _start_pages(context: RunContext, swarm: Swarm, *, has_truth: bool) -> None:
    """Start the pages of the person and of the researcher, if the run has them, and say where they are."""
    options, say = context.options, context.reporter.say
    station, urls = options.station, {}
    if station and station.is_elsewhere:
        swarm.follow(station, options.conductor)
    elif station:
        urls = {"url": swarm.start_station(), "watch_url": station.watch_url}
        say(f"station: {urls['url']}")
        say(f"only to watch it: {station.watch_url}")
    if options.researcher and has_truth:
        page = options.researcher_page or StationChannel()
        feed = ResearcherFeed(page.operators_end, swarm.run, context.scenario, is_beside_operator=station is not None)
        context.observers.append(feed)
        urls["researcher_url"] = swarm.start_station(page, 1)
        swarm.conductor = page if station else None
        say(f"conductor's page, which shows the truth: {urls['researcher_url']}")
    if station and not station.is_elsewhere:
        announce(context.folder.path, urls, opens_browser=station.opens_browser)


def _note_failed_start(context: RunContext, swarm: Swarm, error: LaunchError | ConnectionError) -> None:
    """Note why a part did not start: first those that have ended, without which others could not."""
    disk.check_spare(context.folder.path)  # a part cannot log that the disk is full
    ending, reason = context.ending, str(error)
    if isinstance(error, LaunchError):
        reason = error.reason
        ending.texts += [f"its log:\n{error.log}"] if error.log else []
    wait_for(swarm.parts[:1], END_KNOWN_WITHIN_S)
    for part in swarm.ended():
        if part.has_failed and (line := part.how_it_ended(BEFORE_READY)) != reason:
            ending.fail(line)
            ending.keep_log(part)
    ending.fail(reason)
