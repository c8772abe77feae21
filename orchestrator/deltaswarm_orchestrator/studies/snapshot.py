"""Run a scenario in one process up to a moment, to draw the swarm at work."""

from deltaswarm_orchestrator.report.plots.density import phi
from deltaswarm_orchestrator.report.plots.swarm import Snapshot
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.scenario import Scenario


def snapshot(scenario: Scenario, time_s: float) -> Snapshot:
    """Run a scenario with its own seed; return the swarm and its incomplete events after the step at `time_s`.

    Raises:
        ValueError: `time_s` is before the start or after the end of the run.
    """
    last = round(time_s / scenario.run.step_s)
    if not 0 <= last < scenario.run.steps:
        raise ValueError(f"a run of {scenario.run.duration_s:.15g} s has no step at {time_s:.15g} s")
    swarm = InProcess(scenario)
    for step in range(last):
        swarm.step(step, False)
    truth = swarm.world.truth(swarm.step(last, True))
    return Snapshot(
        time_s=truth.time_s,
        width_m=scenario.arena.width_m,
        height_m=scenario.arena.height_m,
        sensing_range_m=scenario.agents.sensing_range_m,
        bodies=truth.bodies,
        events=tuple(event for event in truth.events if event.completed_s is None),
        phi=phi(scenario),
    )
