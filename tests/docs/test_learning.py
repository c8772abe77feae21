"""The page on learning: its snippets run in order, and its tables are the code's."""

import re
from typing import Any

from deltaswarm_learn.environment import SwarmEnv
from deltaswarm_learn.rewards import REWARDS
from deltaswarm_learn.vectors import VectorSettings, action_size, observation_shapes
from tests.support.pages import ROOT

PAGE = (ROOT / "docs" / "LEARNING.md").read_text()


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
