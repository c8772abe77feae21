"""Train the policy by an evolution strategy: `python train.py` writes weights.npy in some minutes on two cores.

Each generation tries pairs of opposite changes of the weights on the same episode, and moves the weights towards what
had the greater return (Salimans et al. 2017, Evolution strategies as a scalable alternative to reinforcement learning).
"""

import argparse
import os
from functools import cache
from multiprocessing import Pool

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one process per core, and small matrices

import numpy as np
from policy import SHAPE, WEIGHTS, Floats, MatrixPolicy

import deltaswarm

REWARD = {"untold": 1.0, "messages": 0.5, "completed": 50.0}
"""Each second for which an event is not told costs 1, each message 0.5; a completed event is worth 50."""

PHASES = ((0.3, 60), (0.15, 40))
"""Standard deviation of the changes of the weights, and number of generations."""

MOMENTUM = 0.8

TRAINING_SEEDS = 1_000_000
"""The seed of the first training episode; the next phase begins a thousand later. The study has other seeds."""


@cache
def environment():
    """Return this process's environment."""
    return deltaswarm.parallel_env("smoke", reward=REWARD)


def episode_return(job: tuple[Floats, int]) -> float:
    """Return the sum of an agent's rewards in an episode, with weights and a seed."""
    weights, seed = job
    env, total = environment(), 0.0
    observations, _ = env.reset(seed=seed)
    policy = MatrixPolicy(weights)  # of all agents at once: none leaves
    while env.agents:
        actions = policy.act(np.stack([observations[agent] for agent in env.agents]))
        observations, rewards, *_ = env.step(dict(zip(env.agents, actions, strict=True)))
        total += rewards["agent_0"]
    return total


def trained(pairs: int, jobs: int, most: int) -> Floats:
    """Return the weights after all phases, each with at most so many generations; they do not depend on `jobs`."""
    weights = np.zeros(SHAPE)
    with Pool(jobs) as pool:
        for phase, (change, generations) in enumerate(PHASES, start=1):
            rng, velocity = np.random.default_rng(phase), np.zeros(SHAPE)
            for generation in range(min(generations, most)):
                changes = rng.standard_normal((pairs, *SHAPE))
                tried = np.concatenate([weights + change * changes, weights - change * changes])
                episode = TRAINING_SEEDS + 1000 * (phase - 1) + generation
                returns = np.array(pool.map(episode_return, [(one, episode) for one in tried]))
                ranks = returns.argsort().argsort().reshape(2, pairs) / (2 * pairs - 1) - 0.5
                gradient = np.tensordot(ranks[0] - ranks[1], changes, axes=1) / pairs
                velocity = MOMENTUM * velocity + gradient
                weights = weights + change / 2 * velocity
                print(f"phase {phase}, generation {generation}: mean return {returns.mean():.0f}", flush=True)
    return weights


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=16, help="pairs of changes in a generation (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--most", type=int, default=1000, help="generations of a phase at most")
    parser.add_argument("--out", default=WEIGHTS, metavar="FILE", help="where to write the weights")
    arguments = vars(parser.parse_args())
    file = arguments.pop("out")
    np.save(file, trained(**arguments))
