"""Measure environment steps per second of CPU time: deltaswarm and MPE's simple_spread in turns, with as many agents.

pip install 'deltaswarm[learn]' mpe2
python learning.py [AGENTS [ROUNDS]]
"""

import sys
import time
from statistics import median

import numpy as np
from mpe2 import simple_spread_v3

import deltaswarm

STEPS = 300


def steps_per_s(env) -> float:
    """Return the speed of an episode with random actions, which are drawn before."""
    env.reset(seed=1)
    rng = np.random.default_rng(1)
    low, high, shape = (getattr(env.action_space(env.agents[0]), name) for name in ("low", "high", "shape"))
    drawn = rng.uniform(low, high, (STEPS, len(env.agents), *shape)).astype(np.float32)
    began = time.process_time()
    for actions in drawn:
        env.step(dict(zip(env.agents, actions, strict=True)))
    return STEPS / (time.process_time() - began)


def main(agents: int = 6, rounds: int = 7) -> None:
    """Print medians and ranges."""
    scenario = "smoke" if agents == 6 else "paper-25"
    keys = {"agents.count": agents}
    made = {
        f"deltaswarm {scenario}": deltaswarm.parallel_env(scenario, keys),
        "MPE simple_spread": simple_spread_v3.parallel_env(N=agents, max_cycles=STEPS + 1, continuous_actions=True),
    }
    speeds = {name: [] for name in made}
    for _ in range(rounds):
        for name, env in made.items():
            speeds[name].append(steps_per_s(env))
    for name, found in speeds.items():
        print(f"{name}, {agents} agents: {median(found):.0f} steps/s ({min(found):.0f} to {max(found):.0f})")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
