"""The page on learning: its snippets run in order, and its tables are the code's."""

import csv
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltaswarm
from deltaswarm_learn.environment import SwarmEnv
from deltaswarm_learn.rewards import REWARDS
from deltaswarm_learn.vectors import VectorSettings, action_size, observation_shapes
from tests.support.pages import ROOT, blocks, shell

PAGE = (ROOT / "docs" / "LEARNING.md").read_text()

EXAMPLE = ROOT / "examples" / "learn"

SHORTER = {
    "python train.py": "--most 1 --pairs 2",
    "deltaswarm run": "--set run.duration_s=60",
    "deltaswarm study": "--set run.duration_s=180 --repeats 1 --out other || [ $? = 1 ] || [ $? = 3 ]",
}


def test_the_snippets_work() -> None:
    """In one namespace, as a reader types them; the second environment rewards those who report."""
    names: dict[str, Any] = {}
    for snippet in re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL):
        exec(compile(snippet, "docs/LEARNING.md", "exec"), names)
    env = names["env"]
    observations, _ = env.reset(seed=1)
    reports = env.action_space("agent_0").low * 0
    reports[4] = 1.0
    _, rewards, *_ = env.step({agent: reports * (agent == "agent_2") for agent in observations})
    assert rewards == {agent: float(agent == "agent_2") for agent in observations}
    assert names["Stay"].act(None, observations["agent_0"]).shape == env.action_space("agent_0").shape


def test_the_tables_are_the_codes() -> None:
    """A row for each argument, part of an observation, and reward; the sizes are those of the default environment."""
    for name in (*observation_shapes(VectorSettings()), *REWARDS):
        assert re.search(rf"^\| `{name}` \|", PAGE, flags=re.MULTILINE), name
    arguments = SwarmEnv.__init__.__annotations__.keys() - {"return"}
    table = PAGE[PAGE.index("| argument") : PAGE.index("Mistakes raise")]
    assert arguments == set(re.findall(r"`(\w+)`", "\n".join(re.findall(r"^\| (.*?) \|", table, flags=re.MULTILINE))))
    for sign, name in ((sign, name) for name, (sign, _) in REWARDS.items()):
        assert f"| `{name}` | {'-' if sign < 0 else '+'} |" in PAGE
    assert action_size(VectorSettings()) == 9


@pytest.fixture
def example(tmp_path: Path) -> Path:
    shutil.copytree(EXAMPLE, tmp_path / "examples" / "learn")
    return tmp_path


def run_of(folder: Path, name: str) -> Any:
    return json.loads((folder / "examples" / "learn" / "runs" / name / "summary.json").read_text())


@pytest.mark.processes
def test_the_trained_policy_runs_as_processes(example: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the digest of one process, and of an episode in which the learner applies the same matrix."""
    commands = [line for line in blocks(PAGE)[-1].splitlines() if not line.startswith(("python", "deltaswarm study"))]
    script = [f"{line} {SHORTER['deltaswarm run'] if line.startswith('deltaswarm') else ''}" for line in commands]
    done = shell("\n".join(script), example)
    assert done.returncode == 0, done.stdout + done.stderr
    summaries = [run_of(example, name) for name in ("in-process", "processes")]
    assert summaries[0]["digest"] == summaries[1]["digest"]
    assert summaries[1]["valid"]
    assert summaries[1]["frames"]["received"] > 0
    monkeypatch.syspath_prepend(EXAMPLE)
    from policy import WEIGHTS, MatrixPolicy

    env = deltaswarm.parallel_env("smoke", {"run.duration_s": 60.0})
    observations, _ = env.reset()
    policies = {agent: MatrixPolicy(np.load(WEIGHTS)) for agent in env.agents}
    while env.agents:
        observations, *_ = env.step({agent: policies[agent].act(observations[agent]) for agent in env.agents})
    assert env.summary()["digest"] == summaries[0]["digest"]


@pytest.mark.slow
def test_training_repeats(example: Path) -> None:
    """By any number of processes: the weights follow from the seed."""
    code = "from train import trained; print(trained(1, {jobs}, 1).tolist())"
    folder = example / "examples" / "learn"
    found = [
        subprocess.run(
            [sys.executable, "-c", code.format(jobs=jobs)], cwd=folder, capture_output=True, text=True, check=True
        ).stdout
        for jobs in (1, 2)
    ]
    assert found[0] == found[1]


def test_the_published_study_has_seeds_of_its_own() -> None:
    """None of those of the training."""
    with (EXAMPLE / "result" / "runs.csv").open() as file:
        runs = list(csv.DictReader(file))
    seeds = {int(row["seed"]) for row in runs}
    trained_on = range(1_000_000, 1_010_000)
    assert f"TRAINING_SEEDS = {trained_on.start:_}" in (EXAMPLE / "train.py").read_text()
    assert len(seeds) == 20
    assert not seeds & set(trained_on)


@pytest.mark.processes
@pytest.mark.slow
def test_the_commands_work(example: Path) -> None:
    """As they stand, with a short training and a small study."""
    lines = blocks(PAGE)[-1].splitlines()
    script = [f"{line} {next((more for verb, more in SHORTER.items() if line.startswith(verb)), '')}" for line in lines]
    done = shell("\n".join(script), example)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (example / "examples" / "learn" / "other" / "page.md").exists()
