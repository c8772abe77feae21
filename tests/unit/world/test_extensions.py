"""Radio models and faults from outside the package: found by name, checked, counted, and asked like shipped ones."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltaswarm_orchestrator.base.provenance import sources
from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process
from deltaswarm_orchestrator.scenarios.load import commented_toml, load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import SettingsError, plain
from deltaswarm_wire.plugin_errors import PluginError
from deltaswarm_wire.session import RouterLink
from deltaswarm_world.core.air.channel.links import Ends
from deltaswarm_world.core.air.radio import Air
from deltaswarm_world.core.environment import Environment
from deltaswarm_world.io.saving import SavedWorld, WorldConfig
from tests.support.cores import play
from tests.support.tiers import in_one_test
from tests.support.weather import put_weather

WRONG = """
import numpy as np
from deltaswarm_wire.messages import Event
from deltaswarm_world.core.dynamics import Points
from deltaswarm_world.core.faults.kind import Kind
from weather import Curtain

class Wrong({base}):
    {body}
"""
"""A plug-in with one member that raises, or that returns what no run can go on with."""

USES = {
    "Kind": 'fault=[{{kind="{name}:Wrong", at_s=3, agents=[0]}}]',
    "Curtain": 'radio.models."{name}:Wrong"={{}}',
    "Points": 'world.dynamics="{name}:Wrong"',
}

FOG, WIND = 'radio.models."weather:Fog".density=0.05', 'fault=[{kind="weather:Wind", at_s=10, agents=[0, 1]}]'


@pytest.fixture(autouse=True)
def weather(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put_weather(tmp_path, monkeypatch)


def scenario(*overrides: str) -> Scenario:
    return load_scenario("smoke", ["run.duration_s=60", "radio.range_m=100", *overrides])


def mistakes(*overrides: str) -> list[tuple[str, str]]:
    with pytest.raises(SettingsError) as caught:
        scenario(*overrides)
    return [(problem.path, f"{problem.given}; {problem.allowed}") for problem in caught.value.problems]


@in_one_test(
    ("override", "path", "said"),
    [
        (
            'radio.models."weather:Fog".density=2.0',
            'radio.models."weather:Fog".density',
            "2.0; must be a number from 0",
        ),
        ('radio.models."weather:Fog".densty=0.1', 'radio.models."weather:Fog".densty', "did you mean 'density'?"),
        ('radio.models."weather:Fog"=3', 'radio.models."weather:Fog"', "3; must be a table"),
        ("radio.models.fogg={}", 'radio.models."fogg"', "did you mean 'fog'?"),
        ("radio.models.loss={}", 'radio.models."loss"', "must be set by the model's own keys in [radio]"),
        ('radio.models."weather:Curtain".a=1', 'radio.models."weather:Curtain".a', "unknown key"),
        ('radio.models."weather:WrongReason"={}', 'radio.models."weather:WrongReason"', "lower-case letters"),
        ('radio.models."weather:Wind"={}', 'radio.models."weather:Wind"', "must be a radio model with reason"),
        ('radio.models."nowhere:Fog"={}', 'radio.models."nowhere:Fog"', "No module named 'nowhere'"),
        (WIND.replace("agents", "speed_mps=11, agents"), "fault[0].speed_mps", "11; must be a number from 0 to 10"),
        (WIND.replace("agents", "sped_mps=1, agents"), "fault[0].sped_mps", "did you mean 'speed_mps'?"),
        (WIND.replace("at_s", "durations_s=3, at_s"), "fault[0].durations_s", "did you mean 'duration_s'?"),
        (WIND.replace("Wind", "Squall"), "fault[0].duration_s", "must be given for weather:Squall"),
        (WIND.replace("weather:Wind", "winds"), "fault[0].kind", "did you mean 'wind'?"),
        (WIND.replace("Wind", "Fog"), "fault[0].kind", "must be a fault with lasts"),
    ],
)
def test_a_mistake_is_one_message(override: str, path: str, said: str) -> None:
    [(found, text)] = mistakes(override)
    assert found == path
    assert said in text


def test_an_effective_scenario_has_their_options() -> None:
    """Defaults included; an entry point's name does as well; so does a scenario's own file."""
    table = plain(scenario(FOG, WIND))
    assert table["radio"]["models"] == {"weather:Fog": {"density": 0.05, "until_s": 1e6}}
    assert table["fault"] == [
        {"kind": "weather:Wind", "at_s": 10.0, "agents": [0, 1], "roots": False, "speed_mps": 0.2}
    ]
    named = plain(scenario("radio.models.fog.density=0.5", WIND.replace("weather:Wind", "wind")))
    assert named["radio"]["models"] == {"fog": {"density": 0.5, "until_s": 1e6}}
    text = commented_toml(scenario(WIND))
    assert "speed of the wind along x [m/s]" in text


def test_their_files_count_for_results() -> None:
    """As a third-party controller's do: a run is resumed, and a sweep reuses runs, only with the same ones."""
    found = sources(scenario(FOG, WIND))
    assert [(source.what, source.name, source.files) for source in found] == [
        ("radio model", "weather:Fog", ("weather",)),
        ("fault", "weather:Wind", ("weather",)),
    ]
    assert found[0].digest == found[1].digest


def columns(*overrides: str) -> list[dict[str, Any]]:
    return [record.columns() for record in play(InProcess(scenario(*overrides)), 60)]


def test_a_model_counts_its_drops_under_its_own_reason() -> None:
    """In a column after the shipped ones'; and what does not arrive adds up."""
    rows = columns(FOG)
    assert sum(row["dropped_fog"] for row in rows) > 0
    names = list(rows[0])
    assert names.index("dropped_fog") == names.index("dropped_dead") + 1
    for before, row in pairwise(rows):
        drops = sum(count for name, count in row.items() if name.startswith("dropped_"))
        others = len(InProcess(scenario()).agents) - 1
        came = before["frames_in_flight"] + row["frames_sent"] * others
        assert came == row["frames_received"] + drops + row["frames_in_flight"]
    assert list(columns()[0]) == [name for name in names if name != "dropped_fog"]


def test_a_model_changes_no_draw_of_another() -> None:
    """Its chance is its own: a fog that is off leaves the run as it is, and two models draw apart."""
    ever = columns("radio.loss=0.3")
    off = columns("radio.loss=0.3", 'radio.models."weather:Fog".density=0.0')
    assert [{name: row[name] for name in ever[0]} for row in off] == ever


def test_contention_comes_after_models_from_outside() -> None:
    """A frame that fog takes takes no room from the others: the medium carries what is left."""
    swarm = InProcess(scenario("radio.contention_bytes_per_s=40", "radio.loss=0.1", "radio.models.fog.density=0.01"))
    list(play(swarm, 3))
    findings, _ = swarm.world.explain(0, 1)
    assert [finding.reason for finding in findings] == ["dead", "range", "loss", "fog", "contention"]


def test_the_link_is_explained_by_the_model() -> None:
    """As by the shipped ones: it is asked about one pair, and what became of each frame adds up."""
    swarm = InProcess(scenario(FOG))
    pairs = [(sender, receiver) for sender in range(len(swarm.agents)) for receiver in range(len(swarm.agents))]
    for record in play(swarm, 60):
        outcomes = [outcome for a, b in pairs if a != b for outcome in swarm.world.explain(a, b)[1]]
        assert outcomes.count("dropped: fog") == record.frames_dropped["fog"]
    findings, _ = swarm.world.explain(0, 1)
    [fog] = [finding for finding in findings if finding.reason == "fog"]
    distance_m = next(finding.numbers["distance_m"] for finding in findings if finding.reason == "range")
    assert fog.numbers == {"share": pytest.approx(min(1.0, 0.05 * distance_m))}


def test_a_model_for_whole_steps_closes_relays_too() -> None:
    agents = Ends(np.arange(2), np.array([[1.0, 1.0], [2.0, 1.0]]))
    assert Air(scenario(FOG)).steady_links(0.0, agents) == [(1, 0), (0, 1)]
    assert Air(scenario('radio.models."weather:Curtain"={}')).steady_links(0.0, agents) == []


def test_a_fault_acts_on_its_agents_from_its_time_on() -> None:
    """Bodies drift by the wind's speed, and those of other agents do not."""
    calm, windy = (InProcess(scenario(*overrides)) for overrides in ((), (WIND,)))
    for step, _ in enumerate(zip(play(calm, 12), play(windy, 12), strict=True)):
        drift_m = windy.world.environment.positions_m - calm.world.environment.positions_m
        if step == 9:
            assert not drift_m.any()
        if step == 10:
            assert drift_m[:2].tolist() == pytest.approx(np.array([[0.2, 0.0], [0.2, 0.0]]))
            assert not drift_m[2:].any()
    assert windy.world.totals(complete=False)["faults"][0]["kind"] == "weather:Wind"


@in_one_test(
    ("base", "body", "said"),
    [
        ("Kind", "def drive(self, velocities_mps): velocities_mps[:] = np.nan", "drive must leave velocities"),
        ("Kind", "def drive(self, velocities_mps): velocities_mps[0] = 1e6", "drive must leave velocities"),
        (
            "Kind",
            "def drive(self, velocities_mps): return velocities_mps / 2",
            "drive must change the velocities in place",
        ),
        ("Kind", "def drive(self): pass", "drive failed: TypeError"),
        ("Kind", "def drive(self, velocities_mps): raise SystemExit(0)", "drive failed: SystemExit"),
        ("Kind", "def distort(self, sensed, _): sensed[0].append(Event(1, np.nan, 0.0))", "distort must leave Events"),
        ("Kind", "def distort(self, sensed, _): sensed[0].append(3)", "distort must leave Events"),
        ("Kind", "def distort(self, sensed, places_m): places_m[:] = 0.0", "distort failed: ValueError"),
        ("Kind", "def misses(self, agent): pass", "misses must be True or False"),
        ("Kind", "def begin(self, fault, living, why): pass", "begin must be True or False"),
        ("Kind", "def begin(self, fault, living, why): living.add(99)", "begin must give a set of agents"),
        ("Kind", "def begin(self, fault, living, why): self._orders.add('no', {0}, why)", "begin failed: ValueError"),
        ("Kind", "deaf = 3", "deaf must give a set of agents"),
        ("Kind", "def __init__(self): pass", " failed: TypeError"),
        ("Points", "def move(self, places, *_): places[0] = np.nan; return places", "move must give positions"),
        ("Points", "def move(self, places, *_): return places + 1e4", "move must give positions"),
        ("Points", "def move(self, places, *_): return places.tolist()", "move must give positions"),
        ("Points", "starts_m = np.zeros((1, 2))", "starts_m must give positions"),
        ("Points", "def misplaced(self, places_m): return [False] * len(places_m)", "misplaced must return a mask"),
        ("Points", "bumped = None", "bumped must give a set of agents"),
        ("Points", "def states(self): return [1]", "states must return None or a state for each"),
        ("Points", "totals = {'share': float('nan')}", "totals must have finite numbers"),
        ("Curtain", "def cuts(self, links, time_s): return np.array([True, False, True])", "cuts must return a mask"),
        ("Curtain", "def cuts(self, links, time_s): return np.full(len(links), np.nan)", "cuts must return a mask"),
        ("Curtain", "def cuts(self, links, time_s): return links.nothing", "cuts failed: AttributeError"),
        ("Curtain", "of = classmethod(lambda cls, context: 3)", "of must return a radio model"),
        ("Curtain", "holds_for_step = 'no'", "holds_for_step must be True or False"),
    ],
)
def test_what_they_do_wrong_ends_the_run_in_one_line(base: str, body: str, said: str, tmp_path: Path) -> None:
    """With class, member, file and line; the run is not complete, and no NaN reaches a body or an agent."""
    name = f"wrong_{abs(hash((base, body)))}"
    (tmp_path / f"{name}.py").write_text(WRONG.format(base=base, body=body))
    outcome = run_in_process(scenario("run.duration_s=20", "record=off", USES[base].format(name=name)))
    assert not outcome.world.get("complete")
    told = outcome.messages[0]
    assert told.startswith(f"{name}:Wrong")
    assert said in told
    assert f"{tmp_path / name}.py:" in told
    assert "\n" not in told


@in_one_test(
    ("body", "said"),
    [
        ("totals = property(lambda self: self.nothing)", "totals failed: AttributeError"),
        ("totals = {'share': float('nan')}", "totals must have finite numbers"),
        ("def totals(self): return {}", "totals must be an attribute or a property"),
        ("def blocked(self): return frozenset()", "blocked must be an attribute or a property"),
    ],
)
def test_wrong_members_of_dynamics_are_refused_before_the_first_step(body: str, said: str, tmp_path: Path) -> None:
    name = f"early_{abs(hash(body))}"
    (tmp_path / f"{name}.py").write_text(WRONG.format(base="Points", body=body))
    with pytest.raises(PluginError, match=f"{name}:Wrong.{said}"):
        Environment(scenario(USES["Points"].format(name=name)))


@in_one_test("base", USES)
def test_a_world_that_cannot_be_saved_is_refused(base: str, tmp_path: Path) -> None:
    """Before the first step, by the plug-in's name; without checkpoints it runs."""
    name, body = f"kept_{base}", "def __init__(self, *given): super().__init__(*given); self.kept = lambda: 0"
    (tmp_path / f"{name}.py").write_text(WRONG.format(base=base, body=body))
    own = scenario(USES[base].format(name=name))
    assert SavedWorld.new(WorldConfig("run", own, RouterLink(""), tmp_path, tmp_path))
    with pytest.raises(PluginError, match=f"{name}:Wrong cannot be saved in a checkpoint"):
        SavedWorld.new(WorldConfig("run", own, RouterLink(""), tmp_path, tmp_path, checkpoint_steps=5))
