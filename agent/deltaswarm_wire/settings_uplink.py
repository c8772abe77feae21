"""The operator's uplink: how reports come from the agents to the operator's base.

Each piece is off by default, and without any of them reports go straight to the operator. What becomes of a
report that meets several is told in the world's `uplink/uplink.py`.
"""

from dataclasses import dataclass

from deltaswarm_wire.checked import Problem, key, plain_value
from deltaswarm_wire.settings_radio import BandwidthSettings, BlackoutSettings, BurstSettings, Place

LEAST_REPORT_BYTES = 82
"""No report is shorter: a root's that names no event, with the smallest numbers."""


@dataclass(frozen=True)
class UplinkBandwidthSettings(BandwidthSettings):
    """What agents can send to the base and what it can take in. The rest waits, first come, first served."""

    sender_bytes_per_s: float = key(0.0, "what an agent can send to the operator; 0: unlimited", low=0, high=1e9)
    receiver_bytes_per_s: float = key(0.0, "what the operator's radio can take in; 0: unlimited", low=0, high=1e9)


@dataclass(frozen=True)
class UplinkSettings:
    """The way of reports to the operator, emulated by the world."""

    loss: float = key(0.0, "share of reports that are lost; relayed: on each hop", low=0, high=1)
    burst: BurstSettings = key(BurstSettings, "loss in bursts, of each agent's link to the base")
    latency_s: float = key(
        0.0,
        "least delay; 0: a report arrives in the step in which it is sent; part of a step is rounded up or down by "
        "chance, which keeps the mean [s]",
        low=0,
        high=3600,
    )
    jitter_s: float = key(
        0.0, "more delay, uniform from 0 to this, rounded together with latency_s [s]", low=0, high=3600
    )
    bandwidth: UplinkBandwidthSettings = key(UplinkBandwidthSettings, "what agents can send and the base take in")
    outages: tuple[BlackoutSettings, ...] = key((), "no report gets through, as tables of from_s, until_s")
    base_m: Place | None = key(None, "where the operator's base is [m]; without it: everywhere in reach", length=2)
    range_m: float | None = key(None, "a report is heard up to here from the base [m]; with base_m", above=0, high=1e6)
    relay: bool = key(False, "beyond the range members of the sender's tree carry a report, a hop a step; else: lost")

    @property
    def is_on(self) -> bool:
        """Whether anything can befall a report; if not, reports are none of the world's business."""
        rates = (self.bandwidth.sender_bytes_per_s, self.bandwidth.receiver_bytes_per_s)
        numbers = (self.loss, self.latency_s, self.jitter_s, *rates)
        return max(numbers) > 0 or self.burst.is_on or bool(self.outages) or self.base_m is not None

    def problems(self) -> list[Problem]:
        """A base has a range, and what is about the range needs a base."""
        found = []
        if self.base_m is not None and self.range_m is None:
            found.append(Problem("range_m", "none", "a base needs a range"))
        if self.base_m is None and self.range_m is not None:
            found.append(Problem("range_m", f"{self.range_m:g}", "a range is that of a base: base_m is needed"))
        if self.base_m is None and self.relay:
            found.append(Problem("relay", "true", "a relay goes to a base: base_m and range_m are needed"))
        return found


def uplink_problems(uplink: UplinkSettings, size_m: tuple[float, float], step_s: float) -> list[Problem]:
    """What `[uplink]` alone cannot show: a base outside the arena, no byte to spare."""
    found = []
    if uplink.base_m is not None and not all(0 <= x <= end for x, end in zip(uplink.base_m, size_m, strict=True)):
        allowed = f"a place within {size_m[0]:g} m x {size_m[1]:g} m is allowed"
        found.append(Problem("uplink.base_m", str(plain_value(uplink.base_m)), allowed))
    for name in ("sender_bytes_per_s", "receiver_bytes_per_s"):
        rate = getattr(uplink.bandwidth, name)
        if 0 < rate * step_s < LEAST_REPORT_BYTES and uplink.bandwidth.queue_bytes < LEAST_REPORT_BYTES:
            needed = f"0, or at least {LEAST_REPORT_BYTES} bytes in a step or in the queue"
            found.append(
                Problem(f"uplink.bandwidth.{name}", f"{rate:g}", f"{needed}, is allowed: no report is smaller")
            )
    return found
