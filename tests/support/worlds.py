"""A world with agents played by a test."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.checked import load
from deltaswarm_wire.envelope import Sample, encode_sample
from deltaswarm_wire.messages import Act, Frame, TreeStatus, encode_act
from deltaswarm_world.core.environment import EventRecord
from deltaswarm_world.core.participants import Participants
from deltaswarm_world.core.world import WorldCore


def sample(counter: int, payload: bytes = b"here") -> bytes:
    """A radio frame of somebody's controller."""
    return encode_sample(Sample(counter, payload))


def an_act(step: int, *observed: int, vx_mps: float = 0.0, until: int | None = None, role: str = "free") -> Act:
    """An act that holds for one step, unless `until` says otherwise."""
    return Act(step, vx_mps, 0.0, observed, TreeStatus(role), step + 1 if until is None else until)


def begin(participants: Participants, step: int) -> list[int]:
    """A step in which all that can be asked are asked."""
    taking_part = participants.taking_part()
    participants.begin(step, taking_part)
    return taking_part


class Stage:
    """A world with agents played by the test, all at one place unless they are moved."""

    def __init__(self, count: int = 3, boards: Sequence[int] = (), **tables: Any) -> None:
        table = {"agents": {"count": count}, "events": {"rate_hz": 0}, **tables}
        self.core = WorldCore(load(Scenario, table), boards)
        self.core.environment.positions_m[:] = 50.0
        self.step = -1
        self.frames: dict[int, Frame] = {}
        self.counters = Counter[int]()

    def event(self, x_m: float, y_m: float) -> int:
        """An event from now on."""
        environment = self.core.environment
        event = EventRecord(len(environment.arrived) + 1, x_m, y_m, 0.0)
        environment.add([event])
        return event.event

    def begin(self, last: bool = False, probe: bool = False) -> dict[int, Frame]:
        """The next step's frames."""
        self.step += 1
        self.frames = dict(self.core.begin(self.step, last, probe))
        return self.frames

    def say(self, agent: int, payload: bytes = b"here") -> bytes:
        """A frame of an agent, with its next counter, taken by the world; its bytes."""
        data = sample(self.counters[agent], payload)
        self.counters[agent] += 1
        assert self.core.intake.hear_radio(agent, data) is None
        return data

    def act(self, agent: int, *observed: int, step: int | None = None, **more: Any) -> str | None:
        """An act, with the events that it claims to observe."""
        return self.core.intake.hear_act(
            agent, encode_act(an_act(self.step if step is None else step, *observed, **more))
        )

    def end(self, *silent: int) -> StepRecord:
        """Acts of all who have not acted, save the silent; then the end of the step."""
        for agent in sorted(self.core.participants.asked - set(silent)):
            assert self.act(agent) is None
        return self.core.end()
