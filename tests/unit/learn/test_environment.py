"""The learning environment: PettingZoo's own tests, whole episodes repeated, observations in their space, faults."""

import copy
import multiprocessing
import os
import pickle
import re
import subprocess
import sys
import threading
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import deltaswarm
from deltaswarm_learn import make
from deltaswarm_learn.environment import SwarmEnv
from deltaswarm_learn.rewards import StepOutcome
from deltaswarm_learn.state import EVENT_NUMBERS, MAX_STATE_EVENTS
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import check_table, load_scenario
from deltaswarm_wire.checked import SettingsError, plain
from tests.support.learning import FAULTS, KILLED, SIZE, Lost, Wanderer, busy_env, digest_of_episode, episode, table_of
from tests.support.tiers import in_one_test

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # PettingZoo's own, of an environment of its own
    from pettingzoo.test import api_test, max_cycles_test, parallel_api_test, parallel_seed_test

SHORT = {"run.duration_s": 20.0}


@pytest.fixture(autouse=True)
def _warnings_are_errors() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def idle(env: SwarmEnv) -> dict[str, Any]:
    return {agent: np.zeros(SIZE, np.float32) for agent in env.agents}


# What PettingZoo tests


@in_one_test(
    "named",
    [
        {"keys": {**SHORT, "fault": FAULTS}, "observation": "dict"},
        {"keys": {**SHORT, "fault": FAULTS}, "leaving": True},
        {"keys": {**SHORT, "fault": [{"kind": "kill", "at_s": 5.0, "fraction": 1.0}]}, "leaving": True},
        {"keys": {**SHORT, "agents.count": 1}, "frame_slots": 0, "event_slots": 0, "message_size": 0},
    ],
)
def test_it_has_the_parallel_api(named: dict[str, Any]) -> None:
    """With agents that stay or leave, die at once or return, and with no slots at all."""
    parallel_api_test(SwarmEnv(**named), 21)


def test_it_passes_the_other_tests_of_pettingzoo() -> None:
    """The AEC API, equal steps for equal seeds, and the number of cycles asked for."""
    api_test(make.env(keys=SHORT), 200)
    parallel_seed_test(busy_env, 20)
    max_cycles_test(make)


# Whole episodes


def test_an_episode_repeats() -> None:
    """All that it returns is the same in one environment twice, in a pickled one, and in another process."""
    env = busy_env()
    other = pickle.loads(pickle.dumps(env))
    first = digest_of_episode(env)
    assert first == digest_of_episode(env) == digest_of_episode(other)
    assert first != digest_of_episode(env, 2)
    script = [sys.executable, "-m", "tests.support.learning"]
    assert subprocess.run(script, capture_output=True, text=True, check=True).stdout.strip() == first


def test_an_episode_is_a_run() -> None:
    """Its digest and metrics are those of a run in which each agent decides for itself by the same policy."""
    settings = {"run.duration_s": 60.0, "run.step_s": 0.5, "events.rate_hz": 1.0, "uplink.latency_s": 1.0}
    settings["events.work_agent_s"] = 5.0
    env = SwarmEnv("smoke", settings | {"radio.loss": 0.2, "fault": FAULTS})
    for _ in episode(env, 5):
        pass
    table = plain(env.scenario) | {"seed": 5}
    table["control"]["mode"] = f"{Wanderer.__module__}:{Wanderer.__qualname__}"
    scenario, problems = check_table(table)
    assert scenario is not None, problems
    run, summary = summarise(run_in_process(scenario), scenario), env.summary()
    timed = {"mode", "wall_s", "steps_per_s", "real_time_factor"}
    assert {key for key in run if run[key] != summary[key]} <= timed
    assert summary["valid"]
    assert summary["frames"]["received"] > 100
    assert summary["completed"] > 0


def test_a_policy_that_is_lost_is_named() -> None:
    """With its class, file and line; its agents fail, and the run is not valid."""
    outcome = run_in_process(load_scenario("smoke", [f"control.mode={Lost.__module__}:Lost", "run.duration_s=5"]))
    assert len(outcome.causes) == 6
    assert f"{Lost.__module__}:Lost.act: an action must have finite numbers" in outcome.causes[0]
    assert re.search(r"learning\.py:\d+\)", outcome.causes[0])


def test_a_copy_goes_on_by_itself() -> None:
    """A learner that plans ahead copies an environment in the midst of an episode."""
    env = busy_env()
    env.reset(seed=3)
    env.step(idle(env))
    other = copy.deepcopy(env)
    ends = []
    for one in (env, other):
        while one.agents:
            one.step(idle(one))
        ends.append(one.summary()["digest"])
    assert ends[0] == ends[1]


def test_episodes_without_a_seed_differ_and_repeat() -> None:
    """The first has the scenario's seed; those after a seed are a sequence that it determines."""
    places = []
    for _ in range(2):
        env = SwarmEnv("smoke", {**SHORT, "seed": 5})
        places.append([env.reset(seed=seed)[0]["agent_0"].tolist() for seed in (None, None, 7, None)])
    assert places[0] == places[1]
    assert len({tuple(place) for place in places[0]}) == 4
    assert places[0][0] == env.reset(seed=5)[0]["agent_0"].tolist()


scenarios = st.fixed_dictionaries(
    {
        "run.step_s": st.sampled_from([0.1, 0.5, 1.0, 3.0]),
        "agents.count": st.integers(5, 7),
        "events.rate_hz": st.sampled_from([0.0, 0.5, 5.0]),
        "agents.sensing_range_m": st.sampled_from([1.0, 15.0]),
    },
    optional={
        "fault": st.lists(st.sampled_from(FAULTS), unique_by=str),
        "radio.loss": st.floats(0, 1),
        "radio.bandwidth": st.just({"sender_bytes_per_s": 40.0, "queue_bytes": 60}),
        "radio.latency_s": st.floats(0, 5),
        "uplink": st.fixed_dictionaries({"base_m": st.just([0.0, 0.0]), "range_m": st.floats(1, 40)}),
        "arena.width_m": st.sampled_from([40.0, 300.0]),
        "everything": st.just(True),
    },
)
sizes = st.fixed_dictionaries(
    {"event_slots": st.integers(0, 3), "frame_slots": st.integers(0, 6)},
    optional={"leaving": st.booleans(), "observation": st.sampled_from(["flat", "dict"])},
)


@settings(max_examples=8)
@given(scenarios, sizes, st.integers(0, 2**40))
def test_observations_are_in_their_space(changes: dict[str, Any], sizes: dict[str, Any], seed: int) -> None:
    """In every step; so is the state, and each loss that the books count has its reason in an info."""
    outcomes: list[StepOutcome] = []
    if changes.pop("everything", False):
        changes = {**table_of(), **changes}
    changes["run.duration_s"] = 12 * changes["run.step_s"]
    changes["fault"] = [
        fault | {"at_s": fault["at_s"] / 6 * changes["run.step_s"]} for fault in changes.get("fault", ())
    ]
    env = SwarmEnv("smoke", changes, reward=lambda outcome: outcomes.append(outcome) or 0.0, **sizes)
    rng = np.random.default_rng(seed)
    observations, infos = env.reset(seed=seed)
    told = []
    while env.agents:
        told.append(infos)
        observations, rewards, _, _, infos = env.step({a: rng.uniform(-1, 1, SIZE) for a in env.agents})
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation), observation
        assert env.state_space.contains(env.state())
        assert rewards.keys() == observations.keys() == infos.keys()
    if sizes.get("leaving"):
        return
    for outcome, info in zip(outcomes, told, strict=True):
        lost = Counter[str]()
        for about in info.values():
            lost.update({reason: len(receivers) for reason, receivers in about["lost"].items()})
        assert lost == Counter({reason: n for reason, n in outcome.record.frames_dropped.items() if n})


def test_lost_reports_have_their_reason() -> None:
    """In the infos of the step after, and nobody else's."""
    env = SwarmEnv("smoke", {**SHORT, "uplink.outages": [{"from_s": 3.0, "until_s": 5.0}]})
    env.reset()
    reports = np.zeros(SIZE, np.float32)
    reports[4] = 1.0
    for step in range(8):
        *_, infos = env.step(idle(env) | {"agent_3": reports})
        outages = [agent for agent, info in infos.items() if info["lost_reports"] == ["outage"]]
        assert outages == (["agent_3"] if step in (3, 4) else [])


# Faults


def test_an_agent_struck_by_a_fault_stays_and_says_so() -> None:
    """A killed one is not alive, a frozen one is not asked; either senses and hears nothing until it is back."""
    env = busy_env(observation="dict")
    seen: dict[str, list[tuple[float, float]]] = {agent: [] for agent in env.possible_agents}
    for observations, *_ in episode(env):
        for agent, parts in observations.items():
            seen[agent].append((float(parts["alive"]), float(parts["asked"])))
            assert parts["asked"] or not any(parts[name].any() for name in ("position", "events", "heard"))
    well, gone, frozen = (1.0, 1.0), (0.0, 0.0), (1.0, 0.0)
    assert seen["agent_5"] == [well] * 31
    assert seen[f"agent_{KILLED}"] == [well] * 3 + [gone] * 28
    assert seen["agent_1"] == [well] * 2 + [frozen] * 3 + [well] * 26
    assert seen["agent_3"] == [well] * 4 + [gone] * 3 + [well] * 24


def test_an_agent_that_leaves_does_not_come_back() -> None:
    """Its process may be started again; then it stands and is silent."""
    env = busy_env(leaving=True)
    left: dict[str, int] = {}
    for step, (observations, _, terminations, _, _) in enumerate(episode(env)):
        assert not left.keys() & observations.keys()
        left |= {agent: step for agent, over in terminations.items() if over}
    assert left == {"agent_2": 3, "agent_3": 4}
    senders = env.summary()["operator"]["per_sender"]
    assert senders.get("3", {"messages": 0})["messages"] <= 4


def test_an_episode_that_all_agents_left_has_a_summary_of_its_whole_length() -> None:
    """It is that of agents which stay, all of them dead."""
    keys = {**SHORT, "fault": [{"kind": "kill", "at_s": 3.0, "fraction": 1.0}]}
    left, stayed = (SwarmEnv("smoke", keys, leaving=leaving) for leaving in (True, False))
    assert len(list(episode(left))) < len(list(episode(stayed)))
    assert left.summary()["digest"] == stayed.summary()["digest"]


def test_keys_within_a_table_change_no_others_of_it(tmp_path: Path) -> None:
    """As in `deltaswarm.run`, which takes numpy's numbers, too."""
    mine = tmp_path / "mine.toml"
    mine.write_text('schema = 1\nname = "mine"\nradio.range_m = 25.0\n')
    env = SwarmEnv(str(mine), {"radio": {"loss": np.float64(0.25)}})
    assert (env.scenario.radio.range_m, env.scenario.radio.loss) == (25.0, 0.25)


def test_an_agent_that_dies_with_the_episode_is_truncated_and_not_terminated() -> None:
    """It is killed in the step after the last one, which only shows where the last actions led."""
    kill = {"kind": "kill", "at_s": 19.0, "agents": [2]}
    env = SwarmEnv("smoke", {**SHORT, "fault": [kill]}, leaving=True, max_cycles=19)
    *_, (observations, _, terminations, truncations, _) = episode(env)
    assert observations["agent_2"][0] == 0
    assert set(terminations.values()) == {False}
    assert set(truncations.values()) == {True}


def test_the_state_tells_sensed_events_from_told_ones() -> None:
    """Agents that stand still sense events, and report none."""
    env = SwarmEnv("smoke", {"run.duration_s": 60.0, "events.rate_hz": 0.5})
    env.reset(seed=1)
    sensed = told = 0.0
    while env.agents:
        env.step(idle(env))
        events = env.state()[-EVENT_NUMBERS * MAX_STATE_EVENTS :].reshape(MAX_STATE_EVENTS, EVENT_NUMBERS)
        sensed, told = sensed + events[:, 4].sum(), told + events[:, 5].sum()
    assert (sensed > 10, told) == (True, 0)


# Wrappers, and what is left behind


def test_four_run_as_a_vector() -> None:
    """SuperSuit's vector resets each at its end; no two have the same episode."""
    import supersuit

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # SuperSuit's own
        one = supersuit.pettingzoo_env_to_vec_env_v1(busy_env())
        four = supersuit.concat_vec_envs_v1(one, 4, num_cpus=0, base_class="gymnasium")
        four.reset(seed=1)
        for _ in range(32):
            observations, rewards, _, truncated, _ = four.step(np.zeros((24, SIZE), np.float32))
            assert observations.shape[0] == len(rewards) == len(truncated) == 24
        assert len({tuple(row) for row in observations[::6].tolist()}) == 4
        four.close()


def test_close_leaves_nothing() -> None:
    """Twice, before an episode and within one: no thread, process or file; and it may be used again."""
    env = busy_env()
    env.close()
    before = threading.active_count(), len(multiprocessing.active_children()), len(os.listdir("/proc/self/fd"))
    env.reset()
    env.close()
    env.close()
    assert before == (
        threading.active_count(),
        len(multiprocessing.active_children()),
        len(os.listdir("/proc/self/fd")),
    )
    with pytest.raises(RuntimeError, match="call reset"):
        env.step({})
    assert len(env.reset()[0]) == 6


# Mistakes

GOOD = np.zeros(SIZE, np.float32)


@in_one_test(
    ("action", "error", "text"),
    [
        (np.zeros(8, np.float32), ValueError, r"agent_2 must be an array of shape \(9,\) \(got \(8,\)\)"),
        (np.zeros((9, 1), np.float32), ValueError, r"got \(9, 1\)"),
        (np.zeros(9, np.int64), TypeError, "an array of floats .got int64"),
        (np.zeros(9, bool), TypeError, "got bool"),
        (np.array(["x"] * 9), TypeError, "an array of floats"),
        (np.full(9, np.nan), ValueError, "finite numbers"),
        (np.full(9, -np.inf), ValueError, "finite numbers"),
        ([[0.0], [0.0, 1.0]], ValueError, "rows of different lengths"),
        (None, TypeError, "got object from NoneType"),
        (3, TypeError, "got int64 from int"),
    ],
)
def test_a_wrong_action_is_refused(action: Any, error: type[Exception], text: str) -> None:
    """The text says whose it is, what must hold, and what was given; the step can be done again."""
    env = SwarmEnv("smoke", SHORT)
    env.reset(seed=1)
    with pytest.raises(error, match=text):
        env.step(idle(env) | {"agent_2": action})
    env.step(idle(env) | {"agent_2": GOOD.astype(np.float64).tolist()})


def test_actions_are_of_the_agents_that_are_there() -> None:
    """One too few, one too many, and no dict."""
    env = SwarmEnv("smoke", SHORT)
    env.reset()
    with pytest.raises(ValueError, match=r"missing: 'agent_1', 'agent_2', .*; not there: 'agent_9'"):
        env.step({"agent_0": GOOD, "agent_9": GOOD})
    with pytest.raises(ValueError, match=r"must be a dict with an action of each agent .got list"):
        env.step([GOOD] * 6)  # type: ignore[arg-type]
    for seed in (-1, 2**63, 1.5, True):
        with pytest.raises(ValueError, match="seed must be a whole number"):
            env.reset(seed=seed)  # type: ignore[arg-type]


@in_one_test(
    ("named", "text"),
    [
        ({"scenario": "smok"}, "did you mean 'smoke'"),
        ({"keys": {"radio.los": 0.1}}, "radio.los"),
        ({"keys": {"run.bound": "density"}}, "run.bound must be none"),
        ({"keys": {"command": [{"at_s": 1.0, "name": "recall"}]}}, "must be a command that"),
        ({"keys": {"control.mode": "hybrid"}}, "control.mode must not be given"),
        ({"reward": "tolt"}, "reward must be one of told, .*did you mean 'told'"),
        ({"reward": {"told": float("nan")}}, "reward must have finite weights"),
        ({"reward": {}}, "reward must be a name"),
        ({"observation": "box"}, "observation must be one of 'flat', 'dict'"),
        ({"max_cycles": 0}, "max_cycles must be a whole number from 1 to 300"),
        ({"max_cycles": 301}, "run.duration_s allows more"),
        ({"render_mode": "human"}, "render_mode must be one of None, 'ansi'"),
        ({"event_slots": -1, "message_size": 65}, r"event_slots(.|\n)*message_size"),
    ],
)
def test_a_wrong_argument_is_refused(named: dict[str, Any], text: str) -> None:
    with pytest.raises(SettingsError, match=text):
        SwarmEnv(**named)


def test_the_public_functions_say_what_is_wrong_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mistake, and the missing extra, with what to install."""
    assert isinstance(deltaswarm.parallel_env(keys=SHORT), SwarmEnv)
    with pytest.raises(deltaswarm.Error, match="reward must be one of"):
        deltaswarm.env(reward="tolt")
    for name, package in (("pettingzoo", "pettingzoo"), ("gymnasium.spaces", "gymnasium")):
        monkeypatch.delitem(sys.modules, "deltaswarm_learn.environment", raising=False)
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(deltaswarm.Error, match=rf"needs {package}: pip install 'deltaswarm\[learn\]'"):
            deltaswarm.parallel_env()


def test_a_line_shows_the_step() -> None:
    """With `render_mode="ansi"` alone; a summary is refused before the end."""
    env = SwarmEnv("smoke", SHORT, render_mode="ansi")
    env.reset(seed=1)
    env.step(idle(env))
    assert str(env.render()).startswith("step 1: 6 agents, ")
    with pytest.raises(RuntimeError, match="must have ended"):
        env.summary()
    assert SwarmEnv("smoke").render() is None
