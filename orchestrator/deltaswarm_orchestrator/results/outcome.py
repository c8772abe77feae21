"""What the parts of one run recorded."""

from dataclasses import dataclass, field
from typing import Any

from deltaswarm_scenario.truth import EventState, StepRecord
from deltaswarm_wire import digest
from deltaswarm_wire.operator_messages import Workload


@dataclass
class Outcome:
    """What the parts of one run recorded."""

    step_records: list[StepRecord] = field(default_factory=list)
    events: list[EventState] = field(default_factory=list)
    workloads: list[Workload] = field(default_factory=list)
    world: dict[str, Any] = field(default_factory=dict)
    operator: dict[str, Any] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    """Messages for the user: agents that failed, and why."""

    @property
    def is_complete(self) -> bool:
        """Whether world and operator both reached the last step."""
        return bool(self.world.get("complete") and self.operator.get("complete"))

    @property
    def digest(self) -> str | None:
        """The run's digest; None if the world's or the operator's is missing."""
        world, operator = self.world.get("digest"), self.operator.get("digest")
        return digest.combine(world, operator) if world and operator else None
