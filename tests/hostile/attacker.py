"""A controller that does as the paper's until a step in which one agent turns: `tests.hostile.attacker:Attacker`."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import count, repeat
from random import Random
from threading import Thread
from typing import TYPE_CHECKING, ClassVar

from deltaswarm_agent.controller import ControllerContext, Decision, Percept
from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_agent.io.process import AgentConfig
from deltaswarm_wire.codec import MAX_ID
from deltaswarm_wire.envelope import Sample, encode_sample
from deltaswarm_wire.keys import ACT, AGENT, FRAME, RADIO, REPORT, Keys
from deltaswarm_wire.messages import Act, TreeStatus, encode_act
from deltaswarm_wire.operator_messages import Report, encode_report
from deltaswarm_wire.session import client_pairs, configured

if TYPE_CHECKING:
    import zenoh

WHO, AT_STEP = 3, 60
BURST = 100
SILENCE = "silence"
"""The attack that is none: the agent merely stops, and all others are compared with it."""

LATENESS = "lateness"
"""The agent answers each frame, but `late_by_s` too late."""


@dataclass(frozen=True)
class Settings:
    """The attack, of `FLOODS`, `REFUSED`, `LATENESS` or `SILENCE`, and the number of sessions that flood at once.

    Each session rests for `rest_s` after every `BURST` samples or requests.
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
    data = encode_act(Act(step - 1, 1.0, 0.0, (), TreeStatus(), step))
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


def declare(session: "zenoh.Session", keys: Keys) -> None:
    """Declare another agent's subscriber and token, and take them back."""
    session.declare_subscriber(keys.agent(WHO + 1, FRAME), _end).undeclare()
    session.liveliness().declare_token(keys.token(AGENT, WHO + 1)).undeclare()


def query(session: "zenoh.Session", keys: Keys) -> None:
    """Ask everybody and the router for everything, offer to answer in another's name, and send and delete in it."""
    session.declare_queryable(keys.agent(WHO + 1, FRAME), _end).undeclare()
    for selector in ("**", "@/**", keys.agent("*", FRAME)):
        session.get(selector, _end)
    session.liveliness().get("**", _end)
    session.put(keys.agent(WHO + 1, REPORT), b"")
    session.delete(keys.agent(WHO + 1, RADIO))


def _end(got: object) -> None:
    """End the process, so that an agent is lost, if it gets what only others may see."""
    if getattr(got, "err", None) is None:
        os._exit(1)


Request = Callable[["zenoh.Session", Keys], None]
REFUSED: dict[str, Request] = {"refused declarations": declare, "refused queries": query}
"""What the router refuses each time."""


def attack(settings: Settings, step: int) -> None:
    """Never returns."""
    if settings.attack != SILENCE:
        config = own_config()
        for _ in range(settings.sessions):
            told = {"config": config, "rest_s": settings.rest_s}
            if request := REFUSED.get(settings.attack):
                thread = Thread(target=persist, kwargs={**told, "request": request}, daemon=True)
            else:
                leaf, samples = FLOODS[settings.attack]
                thread = Thread(target=flood, kwargs={**told, "leaf": leaf, "samples": samples(step)}, daemon=True)
            thread.start()
    while True:
        time.sleep(60)


def in_bursts(rest_s: float) -> Iterator[None]:
    """Yield without end, with a rest after each burst."""
    while True:
        yield from repeat(None, BURST)
        time.sleep(rest_s)


def persist(config: AgentConfig, rest_s: float, request: Request) -> None:
    """Request what only another agent may, as fast as it goes between rests."""
    import zenoh

    with zenoh.open(configured(zenoh.Config, client_pairs(config.link), config.link)) as session:
        for _ in in_bursts(rest_s):
            request(session, Keys(config.run))


def flood(config: AgentConfig, rest_s: float, leaf: str, samples: Iterator[bytes]) -> None:
    """Put on the agent's own key as fast as it goes between rests, in a session of its own."""
    import zenoh

    session = zenoh.open(configured(zenoh.Config, client_pairs(config.link), config.link))
    key = Keys(config.run).agent(config.agent, leaf)
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    while not publisher.matching_status.matching:  # type: ignore[attr-defined]
        time.sleep(0.001)
    for data, _ in zip(samples, in_bursts(rest_s), strict=True):
        publisher.put(data)
