"""Scenarios: built-in and from files, changed from the command line, and every mistake said at once."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_orchestrator.scenarios import BUILT_IN
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.scenario import RECORDS, Scenario
from deltaswarm_wire.checked import SettingsError, load, plain
from deltaswarm_wire.settings import AgentSettings
from tests.support.complaints import names
from tests.support.swarms import told
from tests.support.tiers import in_one_test


def problems(name: str, *overrides: str, seed: int | None = None) -> list[str]:
    with pytest.raises(SettingsError) as caught:
        load_scenario(name, overrides, seed)
    return [str(problem) for problem in caught.value.problems]


def written(folder: Path, text: str) -> str:
    file = folder / "mine.toml"
    file.write_text(text)
    return str(file)


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_scenarios_load(name: str) -> None:
    """By name, wherever the command is called, and they carry that name."""
    assert load_scenario(name).name == name


def test_the_base_scenario_is_the_papers() -> None:
    """What it sets is what an empty scenario has: the defaults are the paper's."""
    scenario = load_scenario("paper-25")
    bare = {"name": "paper-25", "control": plain(PaperSettings()) | {"mode": "hybrid"}}
    assert load(Scenario, {**plain(Scenario()), **bare}) == scenario
    assert (scenario.agents.count, scenario.run.steps, scenario.control.options["delta"]) == (25, 9000, 3)


def test_the_large_scenario_has_the_base_ones_density_of_agents() -> None:
    """Four times the agents on four times the area."""
    base, large = load_scenario("paper-25"), load_scenario("paper-100")
    areas_m2 = [one.arena.width_m * one.arena.height_m for one in (base, large)]
    assert large.agents.count == 4 * base.agents.count
    assert areas_m2[1] == 4 * areas_m2[0]


@in_one_test(
    ("override", "found"),
    [
        ("control.mode=hierarchical", lambda s: s.control.mode == "hierarchical"),
        ('control.mode="hierarchical"', lambda s: s.control.mode == "hierarchical"),
        ("control.recruitment=false", lambda s: s.control.options["recruitment"] is False),
        ("agents.count=7", lambda s: s.agents.count == 7),
        ("radio.range_m=12", lambda s: s.radio.range_m == 12.0 and type(s.radio.range_m) is float),
        ("radio.loss=1e-1", lambda s: s.radio.loss == 0.1),
        ("events.density.mean_m=[10, 20.5]", lambda s: s.events.density.mean_m == (10.0, 20.5)),
        ("events.density.kind=uniform", lambda s: s.events.density.kind == "uniform"),
        ("name=other-1", lambda s: s.name == "other-1"),
        ("  seed = 12", lambda s: s.seed == 12),
    ],
)
def test_any_key_can_be_set(override: str, found: Any) -> None:
    """Dotted, with TOML values; a plain word is a string."""
    assert found(load_scenario("smoke", [override]))


def test_the_last_override_wins_and_the_seed_above_all() -> None:
    scenario = load_scenario("smoke", ["seed=3", "agents.count=5", "agents.count=8", "seed=4"], seed=9)
    assert (scenario.agents.count, scenario.seed) == (8, 9)


@in_one_test(
    ("override", "said"),
    [
        ("agents.count=2.5", "agents.count: 2.5"),
        ("agents.count=many", "agents.count: 'many'"),
        ("control.recruitment=1", "control.recruitment: 1"),
        ("radio.loss=1.5", "radio.loss: 1.5"),
        ("radio.loss=nan", "radio.loss: nan"),
        ("control.mode=swarm", "control.mode: 'swarm'"),
        ("control.dela=4", "control.dela"),
        ("agent.count=4", "agent"),
        ("zzz=4", "zzz"),
        ("agents=4", "agents: 4"),
        ("agents.count.x=4", "agents.count.x: 'count' is not a table"),
        ("agents.count", "--set: 'agents.count'"),
        ("=4", "--set: '=4'"),
        ("a..b=4", "--set: 'a..b=4'"),
        ("schema=2", "schema: 2"),
        ("seed=" + "9" * 5000, "seed: '9999"),
        ("name=" + "[" * 5000, "name: '[[[["),
    ],
)
def test_a_wrong_override_is_explained(override: str, said: str) -> None:
    (problem,) = problems("smoke", override)
    assert names(problem, said), problem


@pytest.mark.parametrize(
    "data",
    [b"schema = ", b"= 1", b"a = 1\na = 2", b"x = " + b"[" * 5000, b"seed = " + b"9" * 5000, b"\xff\xfe\x00"],
    ids=lambda data: repr(data[:20]),
)
def test_a_file_that_is_no_toml_is_refused(tmp_path: Path, data: bytes) -> None:
    """With the place in it, where its reader gives one; never by an exception of the reader's own."""
    file = tmp_path / "mine.toml"
    file.write_bytes(data)
    (problem,) = problems(str(file))
    assert names(problem, f"{file}: TOML")


def test_a_scenario_says_its_schema(tmp_path: Path) -> None:
    """So that later versions can tell old files."""
    (problem,) = problems(written(tmp_path, 'name = "mine"'))
    assert names(problem, "schema: 1")


@pytest.mark.parametrize("suffix", ["npy", "csv"])
def test_a_grid_is_relative_to_its_scenario(tmp_path: Path, suffix: str) -> None:
    grid = np.array([[1.0, 2.0]])
    if suffix == "npy":
        np.save(tmp_path / "weights.npy", grid)
    else:
        np.savetxt(tmp_path / "weights.csv", grid, delimiter=",")
    text = f'schema = 1\n[events.density]\nkind = "grid"\nfile = "weights.{suffix}"\n'
    density = load_scenario(written(tmp_path, text)).events.density
    assert density.file == str(tmp_path / f"weights.{suffix}")


def test_a_grid_of_an_override_is_relative_to_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run keeps its path as it is then: what reads the run later lies elsewhere."""
    monkeypatch.chdir(tmp_path)
    np.savetxt("grid.csv", np.eye(3), delimiter=",")
    for override in ('events.density.file="grid.csv"', "events.density.file=grid.csv"):
        scenario = load_scenario("smoke", ["events.density.kind=grid", override])
        assert scenario.events.density.file == str(tmp_path / "grid.csv")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no array"])
@pytest.mark.parametrize("suffix", ["npy", "csv"])
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_a_grid_that_cannot_be_read_is_refused_before_anything_starts(
    tmp_path: Path, content: bytes, suffix: str
) -> None:
    """Also an empty file, and one that is no array of numbers."""
    file = tmp_path / f"weights.{suffix}"
    file.write_bytes(content)
    (problem,) = problems("smoke", "events.density.kind=grid", f"events.density.file={file}")
    assert problem.startswith("events.density.file")


def test_a_zip_of_arrays_is_no_grid(tmp_path: Path) -> None:
    np.savez(tmp_path / "weights.npz", weights=np.ones((2, 2)))
    file = (tmp_path / "weights.npz").rename(tmp_path / "weights.npy")
    assert len(problems("smoke", "events.density.kind=grid", f"events.density.file={file}")) == 1


overrides = st.fixed_dictionaries(
    {},
    optional={
        "seed": st.integers(0, 2**63 - 1),
        "record": st.sampled_from(RECORDS),
        "control.mode": st.sampled_from(["decentralised", "hierarchical", "hybrid"]),
        "control.dissolution": st.sampled_from(["true", "false"]),
        "control.d_min_m": st.floats(0, 8.9),
        "radio.loss": st.floats(0, 1),
        "run.duration_s": st.integers(1, 10**8).map(float),
        "agents.speed_mps": st.floats(1e-9, 100),
        "events.density.mean_m": st.lists(st.floats(0, 40), min_size=2, max_size=2),
        "name": st.from_regex(r"[a-z][a-z0-9-]{0,20}", fullmatch=True),
    },
)


@given(overrides)
def test_the_effective_scenario_reads_back_as_it_was(changes: dict[str, Any]) -> None:
    """Every key written out as TOML, to the last bit; so is what an agent is told."""
    scenario = load_scenario("smoke", [f"{key}={value}" for key, value in changes.items()])
    text = to_toml(scenario)
    assert load(Scenario, tomllib.loads(text)) == scenario
    assert to_toml(load(Scenario, tomllib.loads(text))) == text
    told = scenario.for_agent(3)
    assert load(AgentSettings, tomllib.loads(to_toml(told))) == told


BAD = """
schema = 1
name = "no spaces allowed"
sed = 4
[run]
duration_s = -5.0
clock = "sundial"
[agents]
count = 0
sensing_range_m = "far"
[events]
rate_hz = [0.1]
[events.density]
mean_m = [50.0]
[radio]
los = 0.1
[control]
delta = 3.5
"""

SAID = {
    "sed": "'seed'",
    "run.duration_s": "above 0",
    "run.clock": "lockstep, realtime",
    "agents.count": "integer",
    "agents.sensing_range_m": "'far'",
    "events.rate_hz": "[0.1]",
    "events.density.mean_m": "2 items",
    "radio.los": "'loss'",
    "control.delta": "3.5",
    "--set": "key=value",
    "seed": "-1",
}


def test_each_of_many_mistakes_is_a_clear_message(tmp_path: Path) -> None:
    """One line each with the key's path and what must hold; exit code 2, and nothing was begun."""
    file = written(tmp_path, BAD)
    wrong = ("--set", "nonsense", "--seed", "-1")
    done = told("run", file, *wrong, "--out", str(tmp_path / "run"), cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    said = {}
    for line in done.stderr.splitlines():
        found = re.fullmatch(r"deltaswarm: ([^: ]+):? (.+)", line)
        assert found, line
        said[found[1]] = found[2]
    assert said.keys() == SAID.keys()
    assert [path for path in SAID if SAID[path] not in said[path]] == []
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_what_no_single_key_shows_is_said_too(tmp_path: Path) -> None:
    """Once each key is right by itself: the name, a d_min beyond the range, a mean outside the arena."""
    table: dict[str, Any] = {"schema": 1, "name": "no spaces", "control": {"d_min_m": 10.0}}
    table["events"] = {"density": {"mean_m": [500.0, 0.0]}}
    found = problems(written(tmp_path, tomli_w.dumps(table)))
    assert [problem.split()[0] for problem in found] == ["name", "events.density.mean_m", "control.d_min_m"]


@in_one_test(
    ("override", "exact"),
    [
        ("seed=-1", "9223372036854775807"),
        ("run.duration_s=1234567.25", "1234567.25"),
        ("run.duration_s=0.30000000000000004", "0.3"),
        ("run.duration_s=1e9", "100000000"),
        ("events.density.path_s=[0,12345678.5,12345677.5]", "12345678.5"),
    ],
)
def test_numbers_in_messages_are_not_rounded(override: str, exact: str) -> None:
    """Neither a limit nor what was found: a user who types a rounded limit would be refused again."""
    path = "events.density.path_m=[[1,1],[2,2],[3,3]]"
    with pytest.raises(SettingsError) as caught:
        load_scenario("smoke", [override, *([path] if "path_s" in override else [])])
    words = str(caught.value).replace("(", " ").replace(")", " ").replace(",", " ").split()
    assert exact in words


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    """Some editors begin each file with one."""
    for encoding in ("utf-8", "utf-8-sig"):
        file = tmp_path / f"{encoding}.toml"
        file.write_text('schema = 1\nname = "mine"\n', encoding=encoding)
        assert load_scenario(str(file)).name == "mine"
