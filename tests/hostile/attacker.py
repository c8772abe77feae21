"""A controller that does as the paper's until a step in which one agent turns: `tests.hostile.attacker:Attacker`."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import count, repeat
from random import Random
from typing import ClassVar

from deltaswarm_agent.controller import ControllerContext, Decision, Percept
from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_agent.process import AgentConfig
from deltaswarm_wire.codec import MAX_ID
from deltaswarm_wire.envelope import Sample, encode_sample
from deltaswarm_wire.keys import ACT, AGENT, FRAME, RADIO, REPORT, Keys
from deltaswarm_wire.messages import Act, Standing, encode_act
from deltaswarm_wire.operator_messages import Report, encode_report
from deltaswarm_wire.session import client_pairs, configured

WHO, AT_STEP = 3, 60
BURST = 100
SILENCE = "silence"
"""The attack that is none: the agent merely stops, and all others are compared with it."""

DENIED = "denied declarations"
"""The agent declares subscribers and tokens that the router refuses, again and again."""

LATENESS = "lateness"
"""The agent answers each frame, but `late_by_s` too late."""


@dataclass(frozen=True)
class Settings:
    """The attack, of `FLOODS`, `DENIED`, `LATENESS` or `SILENCE`, and the number of sessions that flood at once.

    Each session rests for `rest_s` after every `BURST` samples or declarations.
    """

    attack: str = SILENCE
    sessions: int = 1
    late_by_s: float = 8.0
    rest_s: float = 0.0


class Attacker:
    """The paper's controller in hybrid mode; agent `WHO` turns in step `AT_STEP` and comes back no more."""

    Settings: ClassVar[type[Settings]] = Settings

    def __init__(self, context: ControllerContext) -> None:
        self._attack = context.settings
        self._agent = context.agent
        self._paper = PaperController(replace(context, mode="hybrid", settings=PaperSettings()))

    def step(self, percept: Percept) -> Decision:
        """Decide, or attack."""
        if self._agent == WHO and percept.step >= AT_STEP and self._attack.attack == LATENESS:
            time.sleep(self._attack.late_by_s)
        elif self._agent == WHO and percept.step >= AT_STEP:
            attack(self._attack, percept.step)
        return self._paper.step(percept)


def own_config() -> AgentConfig:
    """What the process was told: all that is in its memory is the attacker's."""
    frame = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
        if isinstance(config := frame.f_locals.get("config"), AgentConfig):
            return config
    raise LookupError("this is no agent's process")


def reports(step: int) -> Iterator[bytes]:
    """Valid ones of the step in which it turned."""
    for number in count():
        yield encode_report(Report(WHO, number, step, "root", 1.0, 1.0, 0, ()))


def reports_to_come(step: int) -> Iterator[bytes]:
    """Of the next 900 steps, and again."""
    for number in count():
        yield encode_report(Report(WHO, number, step + 1 + number % 900, "root", 1.0, 1.0, 0, ()))


def frames(step: int) -> Iterator[bytes]:
    """Radio frames whose envelope is well."""
    for number in count():
        yield encode_sample(Sample(number % 2**32, b"noise" * 20))


def acts(step: int) -> Iterator[bytes]:
    """Of a step that is closed."""
    data = encode_act(Act(step - 1, 1.0, 0.0, (), Standing(), step))
    while True:
        yield data


def last_numbers(step: int) -> Iterator[bytes]:
    """Radio frames with the highest number that the wire carries, and the one after it."""
    for number in count():
        yield encode_sample(Sample(MAX_ID if number % 2 else 0, b"noise"))


def malformed(step: int) -> Iterator[bytes]:
    """Bytes at random, acts that were cut off, deep nesting, and now and then a sample of 30 kB."""
    rng = Random(step)
    act = next(acts(step))
    while True:
        yield rng.randbytes(rng.randrange(200))
        yield act[: rng.randrange(len(act))]
        yield b"\x91" * rng.randrange(1, 2000)
        if rng.random() < 0.01:
            yield rng.randbytes(30_000)


FLOODS: dict[str, tuple[str, Callable[[int], Iterator[bytes]]]] = {
    "reports": (REPORT, reports),
    "reports of steps to come": (REPORT, reports_to_come),
    "radio frames": (RADIO, frames),
    "acts": (ACT, acts),
    "frames with last numbers": (RADIO, last_numbers),
    "malformed reports": (REPORT, malformed),
    "malformed frames": (RADIO, malformed),
    "malformed acts": (ACT, malformed),
}


def attack(settings: Settings, step: int) -> None:
    """Never returns."""
    if settings.attack != SILENCE:
        config = own_config()
        for _ in range(settings.sessions):
            target, told = (declare, ()) if settings.attack == DENIED else (flood, (*FLOODS[settings.attack], step))
            threading.Thread(target=target, args=(config, settings.rest_s, *told), daemon=True).start()
    while True:
        time.sleep(60)


def in_bursts(rest_s: float) -> Iterator[None]:
    """Yield without end, with a rest after each burst."""
    while True:
        yield from repeat(None, BURST)
        time.sleep(rest_s)


def declare(config: AgentConfig, rest_s: float) -> None:
    """Declare what only another agent may, and take it back, as fast as it goes."""
    import zenoh

    keys = Keys(config.run)
    with zenoh.open(configured(zenoh.Config, client_pairs(config.link), config.link)) as session:
        for _ in in_bursts(rest_s):
            session.declare_subscriber(keys.agent(WHO + 1, FRAME), lambda _: None).undeclare()
            session.liveliness().declare_token(keys.token(AGENT, WHO + 1)).undeclare()


def flood(config: AgentConfig, rest_s: float, leaf: str, samples: Callable[[int], Iterator[bytes]], step: int) -> None:
    """Put on the agent's own key as fast as it goes between rests, in a session of its own."""
    import zenoh

    session = zenoh.open(configured(zenoh.Config, client_pairs(config.link), config.link))
    key = Keys(config.run).agent(config.agent, leaf)
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    while not publisher.matching_status.matching:
        time.sleep(0.001)
    for data, _ in zip(samples(step), in_bursts(rest_s), strict=True):
        publisher.put(data)
