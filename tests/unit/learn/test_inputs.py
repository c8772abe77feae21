"""Which inputs of a learned rule decide."""

from pathlib import Path

import numpy as np
import pytest

from deltaswarm_agent.controllers.paper.policy import INPUTS, WEIGHTS
from deltaswarm_cli.main import main
from deltaswarm_learn.inputs import influences, noted, table_of
from deltaswarm_learn.training import learned


def weights(**by_input: float) -> list[float]:
    """Return a policy in which delta has these weights."""
    found = [0.0] * WEIGHTS
    for name, weight in by_input.items():
        found[1 + INPUTS.index(name)] = weight
    return found


def test_only_an_input_with_a_weight_decides() -> None:
    """Delta is 3 + 3 times `busy`, from 3 to 6: by 0 or 1 with the same frequency, half of the permuted ones differ."""
    inputs = np.zeros((4000, len(INPUTS)))
    inputs[::2, INPUTS.index("busy")] = 1.0
    found = {one.input: one for one in influences(weights(busy=1.0), inputs)}
    assert found["busy"].delta == pytest.approx(1.5, abs=0.05)
    assert found["busy"].delta_at == (3.0, 6.0)
    assert found["busy"].working_at == (1.0, 1.0)
    assert {one.delta for name, one in found.items() if name != "busy"} == {0.0}
    assert table_of(list(found.values())).splitlines()[2].startswith("| `busy` | 1.")


def test_delta_beyond_never_changes_nothing() -> None:
    inputs = np.zeros((100, len(INPUTS)))
    inputs[:, INPUTS.index("price")] = np.linspace(0.5, 1.0, 100)
    found = {one.input: one for one in influences(weights(price=100.0), inputs)}
    assert found["price"].delta == 0.0
    assert found["price"].delta_at == (12.0, 12.0)


def test_what_agents_decide_by_is_noted_every_30_s() -> None:
    """In 90 s twice of each agent, with the task's price."""
    rows = noted([1], ["run.duration_s=90", "agents.count=3"], learned([0.0] * WEIGHTS))
    assert rows.shape == (2 * 3, len(INPUTS))
    assert np.all(np.abs(rows) <= 1.0)
    assert len(set(rows[:, INPUTS.index("price")])) == 1


def test_the_command_writes_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "inputs.md"
    given = ["--set", "run.duration_s=90", "--set", "agents.count=3", "--validation-tasks", "1", "--out", str(out)]
    assert main(["learn", "inputs", *given]) == 0
    assert all(f"| `{name}` |" in out.read_text() for name in INPUTS)
    assert main(["learn", "inputs", "--policy", str(out), *given]) == 2
    assert "--policy" in capsys.readouterr().err
    assert main(["learn", "inputs", *given, "--set", "run.duration_s=30"]) == 2
    assert "must last more than 30 s" in capsys.readouterr().err
