"""Replays a run at the operator's console from what reached the operator, at any time, forwards and backwards.

Pure: the steps of a run in, the station's datagrams out. A replay shows nothing that the operator did not know then.
"""

import copy
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import page_hello
from deltaswarm_operator.core.intents import INTENTS
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_scenario.page_messages import REPLAY, Message, answers, made
from deltaswarm_scenario.person_tables import PERSON
from deltaswarm_wire.operator_messages import Clock, Report, Workload

KEPT_EVERY_STEPS = 200
"""Interval at which a copy of the console is kept: a jump back repeats at most this many steps."""

FASTEST = 200.0
"""Simulated seconds per wall second, if the speed is "as fast as possible"."""

ACTS_AT_ONCE = 200

SPEEDS = (-20, -5, -1, 1, 2, 5, 10, 20, 50, 0)


class RecordedStep(NamedTuple):
    clock: Clock
    workload: Workload
    reports: tuple[Report, ...]
    read: tuple[int, ...] = ()
    """Items of the inbox that the person read before the next step."""
    acts: tuple[Message, ...] = ()
    """What the person did and answered before the next step, in the page's format."""


class Replay:
    """The replay of one run. Times are simulated [s] unless they say wall.

    Args:
        briefing: the operator's briefing; its `command` has the commands that were given.
        steps: all steps in order, at least one.
        worth: a line about what an order was worth, by the order's place among all, for those that have one.
    """

    def __init__(
        self, briefing: Briefing, steps: Sequence[RecordedStep], worth: Mapping[str, str] | None = None
    ) -> None:
        self.speed, self.is_paused = briefing.speed or 1.0, False
        self._steps = steps
        self._worth = dict(worth or {})
        self._acts = [act for step in steps for act in step.acts]
        self._step_s = briefing.step_s
        self._console = Console(briefing)
        self._done = 0
        """Number of steps that the console has taken in."""
        self._kept = {0: copy.deepcopy(self._console)}
        self._newly_read: list[int] = []
        """Items read since the page was last told."""
        self._from_s, self._to_s = steps[0].clock.time_s, steps[-1].clock.time_s
        self._now_s = self._from_s
        self._told_wall_s: float | None = None

    def tick(self, wall_s: float) -> None:
        passed_s = wall_s - (wall_s if self._told_wall_s is None else self._told_wall_s)
        self._told_wall_s = wall_s
        if not self.is_paused:
            self.seek(self._now_s + passed_s * (self.speed or FASTEST))

    def seek(self, time_s: float) -> None:
        """Go to a time, forwards or backwards; a time beyond the run goes to its first or last step."""
        self._now_s = min(max(time_s, self._from_s), self._to_s)
        if self._done and self._steps[self._done - 1].clock.time_s > self._now_s:
            self._done = max(done for done in self._kept if not done or self._time_s(done) <= self._now_s)
            self._console = copy.deepcopy(self._kept[self._done])
            self._newly_read.clear()
        while self._done < len(self._steps) and self._steps[self._done].clock.time_s <= self._now_s:
            clock, workload, reports, read, _ = self._steps[self._done]
            self._console.close_step(clock, workload, reports, 0.0)
            self._newly_read += self._console.ledger.read(read, self._console.picture.now_s)
            acts = self._console.take_actions()  # of a simulated person
            self._newly_read += [int(item) for act in acts for item in act.items.split()]
            self._done += 1
            if self._done % KEPT_EVERY_STEPS == 0 and self._done not in self._kept:
                self._kept[self._done] = copy.deepcopy(self._console)

    def _time_s(self, done: int) -> float:
        return self._steps[done - 1].clock.time_s

    def hello(self, run: str) -> Message:
        return page_hello(self._console, run, "replay", SPEEDS) | ({"worth": self._worth} if self._worth else {})

    def newly_read(self) -> list[Message]:
        """Return what the page must not miss: the items that were read since."""
        read, self._newly_read = self._newly_read, []
        return [made("read", items=read)] if read else []

    def show(self) -> Message:
        bar = {"from_s": self._from_s, "to_s": self._to_s, "speed": self.speed, "paused": self.is_paused}
        acts = [act for act in self._acts if act["kind"] == "judge" and act["time_s"] <= self._now_s]
        answers = {act["event"]: act["name"] for act in acts}
        judged = [[event, answers[event]] for event in self._console.picture.events if event in answers]
        pace = {"paused": self.is_paused, "speed": self.speed}
        return self._console.show(0.0, replay=bar, judged=judged, pace=pace, probe=None)

    def intend(self, data: bytes) -> list[Message]:
        return answers(data, REPLAY, self._act)

    def _act(self, raw: Message) -> list[Message]:
        kind = raw["type"]
        if kind == "seek":
            self.seek(raw["time_s"])
        elif kind == "catch_up":
            return [*self._console_answers(raw), *self._told_acts(raw["from"])]
        elif kind != "pace":
            return self._console_answers(raw)
        elif "speed" in raw:
            self.speed = min(max(raw["speed"], -FASTEST), FASTEST)
        elif "steps" in raw:
            self.seek(self._now_s + raw["steps"] * self._step_s)
            self.is_paused = True
        else:
            self.is_paused = raw.get("paused", self.is_paused)
        return []

    def _console_answers(self, raw: Message) -> list[Message]:
        return INTENTS[raw["type"]](self._console, raw, {"by": PERSON, "monotonic_s": 0.0, "page": raw["from"]})

    def _told_acts(self, page: int) -> list[Message]:
        acts = self._acts
        return [
            made("acts", to=page, acts=acts[at : at + ACTS_AT_ONCE], is_first=not at)
            for at in range(0, max(1, len(acts)), ACTS_AT_ONCE)
        ]
