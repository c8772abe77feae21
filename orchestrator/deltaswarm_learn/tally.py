"""The numbers of each step that rewards are made of."""

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.operator_messages import Workload


class Tally:
    """Follows the events of one run, step by step."""

    def __init__(self, scenario: Scenario) -> None:
        self._step_s, self._horizon_s = scenario.run.step_s, scenario.metrics.horizon_s
        self._untold: dict[int, float] = {}
        """When each event arrived of which the operator has not been told, no longer ago than the horizon [s]."""
        self._arrived = self._reported = 0

    def count(self, swarm: InProcess, record: StepRecord, workload: Workload) -> dict[str, float]:
        """Return the numbers of the step that was closed last, by their names in `REWARDS`."""
        environment, told_s, now_s = swarm.world.environment, swarm.operator.told_s, record.time_s
        new = environment.arrived[self._arrived :]
        self._untold |= {event.event: event.arrived_s for event in new if event.arrived_s <= now_s}
        self._arrived = len(environment.arrived)
        oldest_s = now_s - self._horizon_s
        newly_told = [event for event in list(told_s)[self._reported :] if event in self._untold]
        self._reported = len(told_s)
        self._untold = {
            event: arrived_s
            for event, arrived_s in self._untold.items()
            if arrived_s > oldest_s and event not in told_s
        }
        changed = {event.event: event for event in environment.changed}.values()
        return {
            "told": len(newly_told),
            "sensed": sum(event.sensed_s == now_s for event in changed),
            "worked": sum(event.worked_s == now_s for event in changed),
            "completed": sum(event.completed_s == now_s for event in changed),
            "untold": len(self._untold) * self._step_s,
            "open": record.events_open * self._step_s,
            "messages": workload.messages,
            "frames": record.frames_sent,
            "bytes": record.bytes_sent,
        }
