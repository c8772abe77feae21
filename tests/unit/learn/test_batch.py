"""Many swarms in one environment: each is what `SwarmEnv` makes of its seed, to the last bit."""

from typing import Any

import numpy as np
import pytest

from deltaswarm_learn.batch import SwarmVectorEnv
from deltaswarm_learn.environment import SwarmEnv
from deltaswarm_learn.rewards import REWARDS
from deltaswarm_wire.checked import SettingsError

RUNS, SEED = 3, 11
WEIGHTS = {name: 0.5 + place for place, name in enumerate(REWARDS)}
CROWDED = {"run.duration_s": 150.0, "events.rate_hz": 0.5, "events.work_agent_s": 10.0, "metrics.horizon_s": 40.0}


def random_actions(rng: np.random.Generator, shape: tuple[int, ...]) -> Any:
    """Some beyond 1, so that they are cut, and many towards the middle, where the events are."""
    return (rng.normal(size=shape) * 0.8).astype(np.float32)


@pytest.mark.parametrize("keys", [{}, {"radio.loss": 0.4, "agents.count": 12}], ids=["whole", "lossy"])
def test_each_run_is_that_of_its_seed(keys: dict[str, Any]) -> None:
    """Its observations, rewards and digest."""
    print(f"seeds {SEED} to {SEED + RUNS - 1}")
    sizes = {"event_slots": 2, "frame_slots": 3, "message_size": 2}
    batch = SwarmVectorEnv(RUNS, "smoke", CROWDED | keys, reward=WEIGHTS, **sizes)
    single = [SwarmEnv("smoke", CROWDED | keys, reward=WEIGHTS, **sizes) for _ in range(RUNS)]
    observed, _ = batch.reset(seed=np.int64(SEED))
    alone = [env.reset(seed=SEED + number)[0] for number, env in enumerate(single)]
    rng = np.random.default_rng(SEED)
    names = single[0].possible_agents
    while True:
        for number, env in enumerate(alone):
            np.testing.assert_array_equal(observed[number], np.stack([env[name] for name in names]))
        actions = random_actions(rng, batch.action_space.shape or ())
        observed, rewards, ended, cut, info = batch.step(actions)
        assert not ended.any()
        for number, env in enumerate(single):
            alone[number], reward, _, truncated, _ = env.step(
                {name: actions[number, agent] for agent, name in enumerate(names)}
            )
            assert rewards[number] == reward[names[0]]
            assert cut[number] == all(truncated.values())
        if cut.all():
            break
    assert info["digest"].tolist() == [env._current().swarm.outcome.digest for env in single]
    assert len(set(info["digest"])) == RUNS
    with pytest.raises(RuntimeError, match="call reset"):
        batch.step(actions)


def test_without_a_seed_each_reset_has_others() -> None:
    batch = SwarmVectorEnv(2, "smoke", {"run.duration_s": 20.0})
    (first, _), (second, _) = batch.reset(), batch.reset()
    assert not np.array_equal(first, second)
    assert not np.array_equal(first[0], first[1])
    again = SwarmVectorEnv(2, "smoke", {"run.duration_s": 20.0}).reset()[0]
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"runs": 0}, "runs must be a whole number from 1 on"),
        ({"keys": {"radio.latency_s": 1.0}}, "radio model other than range and loss"),
        ({"keys": {"uplink.loss": 0.1}}, "uplink"),
        ({"keys": {"world.dynamics": "physics"}}, "world.dynamics"),
        ({"reward": "fun"}, "reward"),
    ],
)
def test_what_it_cannot_do_is_said_before(arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(SettingsError, match=says):
        SwarmVectorEnv(**{"runs": 2, **arguments})


@pytest.mark.parametrize("wrong", [np.zeros((2, 6, 8), np.float32), np.zeros((2, 6, 9), np.int64)])
def test_wrong_actions_are_refused(wrong: Any) -> None:
    batch = SwarmVectorEnv(2, "smoke")
    batch.reset(seed=[4, 5])
    with pytest.raises(ValueError, match=r"of shape \(2, 6, 9\)"):
        batch.step(wrong)
    with pytest.raises(ValueError, match="2 of them"):
        batch.reset(seed=[4])
