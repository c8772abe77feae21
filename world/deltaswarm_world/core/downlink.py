"""The operator's downlink: which agents hear the base's radio frames, and when; the mirror of `uplink/`.

The base sends a command at once and then repeats the unexpired ones. Agents relay what they hear by themselves. The
base's frames are not counted among the agents' frames.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.commands import BASE_ID, Relayed, Signed, decode_command, encode_relayed
from deltaswarm_wire.envelope import Sample, encode_sample, fitting
from deltaswarm_world.core.air.channel.queues import Packet, delays_of
from deltaswarm_world.core.air.channel.zones import is_on
from deltaswarm_world.core.arrays import Floats, generator

LOSS_STREAM, JITTER_STREAM, ROUNDING_STREAM = 51, 52, 53
"""Each model has its own generator, as for radio."""

MAX_FRAME_BYTES = 800
"""Maximum size of relayed commands, so that a frame of the base fits into an agent's frame, whatever else it hears."""

NEVER = -1


@dataclass
class _Alive:
    signed: Signed
    ends: int
    sent_at: int = NEVER
    """The step of the newest frame with it."""


class Downlink:
    """The downlink of one run; `carry` is called once a step, in order."""

    def __init__(self, scenario: Scenario) -> None:
        settings, step_s = scenario.downlink, scenario.run.step_s
        self.frames_sent = self.frames_heard = 0
        self.dropped: Counter[str] = Counter()
        """Frames that an agent did not hear, by reason."""
        self._settings = settings
        self._step_s = step_s
        self._count = scenario.agents.count
        self._base_m = np.array(settings.base_m or scenario.uplink.base_m or (0.0, 0.0))
        self._alive: list[_Alive] = []
        self._new = False
        self._repeat_steps = max(1, round(settings.repeat_s / step_s))
        self._repeat_at = 0
        self._rng = generator(scenario.seed, LOSS_STREAM)
        has_delay = settings.latency_s > 0 or settings.jitter_s > 0
        self._delays = delays_of(settings, scenario, JITTER_STREAM, ROUNDING_STREAM) if has_delay else None

    def send(self, step: int, commands: Sequence[Signed]) -> None:
        for signed in commands:
            life_s = decode_command(signed.body).life_s
            self._alive.append(_Alive(signed, step + max(1, round(life_s / self._step_s))))
            self._new = True

    @property
    def next_sending_step(self) -> int | None:
        """The first step in which `carry` may have something to send; None if nothing is repeated."""
        if not self._alive:
            return None
        return 0 if self._new else self._repeat_at

    def carry(
        self, step: int, time_s: float, positions_m: Floats, listening: Sequence[bool]
    ) -> list[tuple[int, bytes]]:
        """Return what agents at these positions [m] hear from the base in this step: (agent, sample) in agent order."""
        if not self._alive and not (self._delays and self._delays.waiting):
            return []
        self._alive = [alive for alive in self._alive if alive.ends > step]
        arriving: list[tuple[int, bytes]] = []
        if self._alive and (self._new or step >= self._repeat_at):
            self._repeat_at = step + self._repeat_steps
            sample = self._sample(step)
            self._new = any(alive.sent_at == NEVER for alive in self._alive)
            arriving = [(agent, sample) for agent in self._in_reach(time_s, positions_m)]
        if self._delays is not None:
            packets = [(agent, Packet(BASE_ID, self.frames_sent, data)) for agent, data in arriving]
            arrived = self._delays.send(step, packets, self._delays.draw(len(packets)).tolist())
            arrived += self._delays.take(step)
            newest = {agent: packet.data for agent, packet in sorted(arrived)}
            self.dropped["overtaken"] += len(arrived) - len(newest)
            arriving = list(newest.items())
        heard = []
        for agent, data in arriving:
            if listening[agent]:
                heard.append((agent, data))
            else:
                self.dropped["dead"] += 1
        self.frames_heard += len(heard)
        return heard

    def _sample(self, step: int) -> bytes:
        """Make the base's next radio frame, with the commands that were sent least recently, as many as fit."""
        wanted = sorted(self._alive, key=lambda alive: alive.sent_at)
        items = fitting((encode_relayed(Relayed(a.ends - step, a.signed)) for a in wanted), MAX_FRAME_BYTES)
        for alive in wanted[: len(items)]:
            alive.sent_at = step
        self.frames_sent += 1
        return encode_sample(Sample(self.frames_sent, None, items))

    def _in_reach(self, time_s: float, positions_m: Floats) -> list[int]:
        settings = self._settings
        lucky = self._rng.random(self._count) >= settings.loss
        if any(is_on(outage, time_s) for outage in settings.outages):
            self.dropped["outage"] += self._count
            return []
        offsets = positions_m - self._base_m
        near = (offsets**2).sum(axis=1) <= (np.inf if settings.range_m is None else settings.range_m**2)
        self.dropped["range"] += int((~near).sum())
        self.dropped["loss"] += int((near & ~lucky).sum())
        reached: list[int] = np.flatnonzero(near & lucky).tolist()
        return reached

    @property
    def totals(self) -> dict[str, Any]:
        return {
            "frames_sent": self.frames_sent,
            "frames_heard": self.frames_heard,
            "in_flight": self._delays.waiting if self._delays else 0,
            "dropped": {reason: count for reason, count in sorted(self.dropped.items()) if count},
        }
