"""What an agent makes of the radio frames that reach it, and of where they came from."""

from collections import deque
from collections.abc import Callable, Sequence

from deltaswarm_agent.obstacles import Obstacles
from deltaswarm_agent.tree import RANGE_MARGIN_M
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.radio import RadioFrame
from deltaswarm_wire.settings import AgentSettings

TRAIL_STEPS = 4
"""An agent comes *newly* into range if it was out of range at one of so many last positions."""

FORGET_SENDER_STEPS = 20
"""A sender unheard for so long may begin its counter anew."""


class Ear:
    """Decodes frames; of each sender it keeps the newest."""

    def __init__(self, agent: int, decode: Callable[[bytes], RadioFrame]) -> None:
        self.rejected = 0
        """Frames that broke the protocol."""
        self._agent = agent
        self._decode = decode
        self._newest: dict[int, tuple[int, int]] = {}

    def newest_of(self, heard: Sequence[bytes], now: int) -> list[RadioFrame]:
        """Of each sender its newest frame, in sender order; late and duplicate ones are dropped."""
        newest: dict[int, RadioFrame] = {}
        decode, known = self._decode, self._newest
        for data in heard:
            try:
                frame = decode(data)
            except WireError:
                self.rejected += 1
                continue
            sender = frame.sender
            before = known.get(sender)
            is_new = before is None or frame.counter > before[0] or now - before[1] > FORGET_SENDER_STEPS
            if is_new and sender != self._agent:
                known[sender] = (frame.counter, now)
                newest[sender] = frame
        return [newest[sender] for sender in sorted(newest)]


class Whereabouts:
    """The agent's place and its last ones [m; world frame], and how far others are from it."""

    def __init__(self, settings: AgentSettings) -> None:
        self.x_m = 0.0
        self.y_m = 0.0
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL_STEPS)
        self._range_m2 = settings.range_m**2
        self._reach_m2 = (settings.range_m - RANGE_MARGIN_M) ** 2
        self._size_m = (settings.width_m, settings.height_m)
        self._obstacles = Obstacles(settings)
        self._d_min_m2 = settings.control.d_min_m**2

    def move_to(self, x_m: float, y_m: float) -> None:
        """The place in this step."""
        self.x_m, self.y_m = x_m, y_m

    def keep(self) -> None:
        """This step's place becomes a past one."""
        self._trail.append((self.x_m, self.y_m))

    def distance_m2(self, x_m: float, y_m: float) -> float:
        """Squared distance to a place [m2]."""
        return (x_m - self.x_m) ** 2 + (y_m - self.y_m) ** 2

    def sender_m2(self, frame: RadioFrame) -> float:
        """Squared distance to a frame's sender [m2]."""
        return (frame.x_cm * 0.01 - self.x_m) ** 2 + (frame.y_cm * 0.01 - self.y_m) ** 2

    def is_newly_met(self, frame: RadioFrame) -> bool:
        """Whether the sender's place was out of range a moment ago ("moves within communication range")."""
        x_m, y_m = frame.x_cm * 0.01, frame.y_cm * 0.01
        return any((x_m - px) ** 2 + (y_m - py) ** 2 > self._range_m2 for px, py in self._trail)

    def is_apart(self, frame: RadioFrame) -> bool:
        """At least d_min away (Tree Growth)."""
        return self.sender_m2(frame) >= self._d_min_m2

    def is_within_reach(self, frame: RadioFrame) -> bool:
        """Within range, less the margin that members keep."""
        return self.sender_m2(frame) <= self._reach_m2

    def is_legal(self, frame: RadioFrame) -> bool:
        """At a distance at which the sender may be this agent's parent."""
        return self._d_min_m2 <= self.sender_m2(frame) <= self._reach_m2

    def is_in_arena(self, x_m: float, y_m: float) -> bool:
        """Whether a place that another agent named can be gone to: straight on, with no obstacle in the way."""
        is_inside = 0.0 <= x_m <= self._size_m[0] and 0.0 <= y_m <= self._size_m[1]
        return is_inside and not self._obstacles.first_crossing(self.x_m, self.y_m, x_m - self.x_m, y_m - self.y_m)
