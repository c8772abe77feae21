"""Every model of the air at once, for a scenario; and an air without a world, for random situations."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from benchmarks.radio_cost import ALL_ON
from hypothesis import strategies as st

import tests.support.strategies  # noqa: F401 (hypothesis's profile)
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from deltaswarm_world.core.air.radio import Air, Reception
from deltaswarm_world.core.arrays import Floats

OBSTACLES = (
    "arena.obstacles=[{corners_m=[[12,12],[16,12],[16,28],[12,28]]},"
    "{corners_m=[[24,8],[34,8],[29,16]],attenuation_db=6}]"
)
"""Two: one blocks, the other one takes some power."""

EVERYTHING = (*ALL_ON, OBSTACLES)
"""As `--set` has it, with times for a run of at least 200 s and places for an arena of at least 40 m."""


def scenario(
    agents: int = 2, seed: int = 1, step_s: float = 1.0, arena: Mapping[str, Any] | None = None, **radio: Any
) -> Scenario:
    """A scenario with a range of 10 m, unless `radio` says otherwise."""
    table = {"seed": seed, "run": {"step_s": step_s}, "agents": {"count": agents}, "radio": {"range_m": 10.0, **radio}}
    return load(Scenario, {**table, "arena": arena or {}})


class Stage:
    """An air, driven by hand: all agents speak and are there, unless told otherwise."""

    def __init__(self, positions_m: Sequence[Sequence[float]] | Floats, seed: int = 1, **radio: Any) -> None:
        self.positions_m = np.array(positions_m, dtype=np.float64).reshape(-1, 2)
        self.scenario = scenario(len(self.positions_m), seed, **radio)
        self.air = Air(self.scenario)
        self.step = -1

    def carry(
        self,
        senders: Sequence[int] | None = None,
        listening: Sequence[bool] | None = None,
        data: Mapping[int, bytes] | None = None,
    ) -> Reception:
        """One step. A frame says in which step it was sent and by whom, unless `data` does."""
        self.step += 1
        agents = range(len(self.positions_m))
        said = {sender: f"{self.step}:{sender}".encode() for sender in (agents if senders is None else senders)}
        there = [True] * len(agents) if listening is None else list(listening)
        time_s = self.step * self.scenario.run.step_s
        return self.air.carry(self.step, time_s, said if data is None else data, self.positions_m, there)


shares = st.floats(0, 1)
places = st.tuples(st.floats(0, 100), st.floats(0, 100)).map(list)
times = st.fixed_dictionaries({"from_s": st.integers(0, 10)}, optional={"until_s": st.integers(11, 20)})
rates = st.sampled_from([0.0, 5.0, 20.0, 100.0])

radios: st.SearchStrategy[dict[str, Any]] = st.fixed_dictionaries(
    {},
    optional={
        "loss": shares,
        "range_m": st.floats(7, 100),
        "reception": st.sampled_from(["disc", "log-distance"]),
        "path_loss": st.fixed_dictionaries(
            {"shadowing_db": st.floats(0, 12), "decorrelation_m": st.sampled_from([0.0, 3.0])},
            optional={"shadowing_symmetric": st.booleans()},
        ),
        "ranges": st.just([{"agents": [0], "range_m": 30.0}]),
        "asymmetry": st.fixed_dictionaries({"dead_share": shares, "range_factor_low": shares}),
        "burst": st.fixed_dictionaries(
            {"p_good_to_bad": shares, "p_bad_to_good": st.floats(0.01, 1), "loss_good": shares, "loss_bad": shares}
        ),
        "latency_s": st.floats(0, 4),
        "jitter_s": st.floats(0, 4),
        "duplication": shares,
        "bandwidth": st.fixed_dictionaries(
            {"sender_bytes_per_s": rates, "receiver_bytes_per_s": rates, "queue_bytes": st.sampled_from([7, 12, 40])}
        ),
        "contention_bytes_per_s": rates,
        "walls": st.lists(times.map(lambda t: {"a_m": [50, 0], "b_m": [50, 100], **t}), max_size=1),
        "jammers": st.lists(
            st.builds(
                lambda t, at, to: {"center_m": at, "radius_m": 30, "waypoints_m": [to], "times_s": [15], **t},
                times,
                places,
                places,
            ),
            max_size=2,
        ),
        "blackouts": st.lists(times, max_size=1),
    },
)
"""Tables of `[radio]`, for arenas of 100 m x 100 m."""
