"""Controllers as plug-ins: found by name, made with their own settings, and told what is wrong in one line."""

from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any, ClassVar

import pytest

from deltaswarm_agent.controller import (
    ControllerContext,
    ControllerError,
    Decision,
    Percept,
    agent_rng,
    described,
    make_controller,
)
from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.potential import PotentialController
from deltaswarm_wire.checked import Problem, SettingsError, key, load
from deltaswarm_wire.plugins import CONTROLLER_GROUP, CONTROLLERS
from deltaswarm_wire.settings import AgentSettings


@dataclass(frozen=True)
class GuideSettings:
    """What a controller of somebody else's may have for options."""

    pace_mps: float = key(0.5, "how fast it walks [m/s]", above=0)

    def problems_with(self, shared: AgentSettings) -> list[Problem]:
        """It cannot walk faster than its body."""
        if self.pace_mps <= shared.speed_mps:
            return []
        return [
            Problem("pace_mps", f"{self.pace_mps:g}", f"at most agents.speed_mps ({shared.speed_mps:g}) is allowed")
        ]


class Guide:
    """A controller of somebody else's."""

    Settings: ClassVar[type[GuideSettings]] = GuideSettings

    def __init__(self, context: ControllerContext) -> None:
        self.context = context

    def step(self, percept: Percept) -> Decision:
        """Walk along x."""
        return Decision((self.context.settings.pace_mps, 0.0))


class WithoutSettings:
    """No controller."""

    def step(self, percept: Percept) -> Decision:
        """Stand."""
        return Decision()


class WithoutStep:
    """No controller."""

    Settings = GuideSettings


class WithPlainSettings:
    """No controller: its settings cannot be checked."""

    Settings: ClassVar[type[Any]] = dict

    def step(self, percept: Percept) -> Decision:
        """Stand."""
        return Decision()


class Broken:
    """Cannot be made."""

    Settings: ClassVar[type[GuideSettings]] = GuideSettings

    def __init__(self, context: ControllerContext) -> None:
        raise RuntimeError("no map\nof the place")

    def step(self, percept: Percept) -> Decision:
        """Never."""
        return Decision()


def settings(mode: str, **options: Any) -> AgentSettings:
    return load(AgentSettings, {"control": {"mode": mode, **options}})


def named(cls: type) -> str:
    return f"{__name__}:{cls.__name__}"


def refused(mode: str, **options: Any) -> list[Problem]:
    with pytest.raises(SettingsError) as caught:
        make_controller(1, settings(mode, **options))
    return caught.value.problems


@pytest.mark.parametrize("mode", CONTROLLERS)
def test_a_shipped_controller_is_made_by_its_short_name(mode: str) -> None:
    """The three modes of the paper are one class."""
    made = make_controller(1, settings(mode))
    assert type(made) is (PotentialController if mode == "potential" else PaperController)


def test_anybodys_class_is_a_controller() -> None:
    """By `module:Class`, with its own options; it is told its agent, its mode and the agent's settings."""
    shared = settings(named(Guide), pace_mps=0.75)
    made = make_controller(5, shared)
    assert isinstance(made, Guide)
    context = made.context
    assert (context.agent, context.mode, context.settings, context.shared) == (
        *(5, named(Guide)),
        GuideSettings(0.75),
        shared,
    )
    assert made.step(Percept(0, 0.0, (0.0, 0.0), (), (), [])) == Decision((0.75, 0.0))


def test_an_installed_package_names_its_controllers(monkeypatch: pytest.MonkeyPatch) -> None:
    """By entry points of the group `deltaswarm.controllers`; they are told of where a name means nothing."""
    point = EntryPoint("guide", named(Guide), CONTROLLER_GROUP)
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [point] if group == CONTROLLER_GROUP else [])
    assert isinstance(make_controller(1, settings("guide")), Guide)
    (problem,) = refused("giude")
    assert "decentralised, guide, hierarchical" in problem.allowed


def test_a_controllers_chance_is_its_own() -> None:
    """It follows from the agent's seed, its id and the number of its restart, and from nothing else."""
    shared = settings(named(Guide))

    def first_draw(agent: int, restart: int = 0) -> float:
        made = make_controller(agent, shared, restart)
        assert isinstance(made, Guide)
        return made.context.rng.random()

    assert first_draw(1) == first_draw(1) == agent_rng(shared.seed, 1).random()
    assert len({first_draw(1), first_draw(2), first_draw(1, 1), first_draw(1, 2)}) == 4


@pytest.mark.parametrize(
    ("mode", "said"),
    [
        (
            "hybird",
            "no such controller; did you mean 'hybrid'? "
            "use one of decentralised, hierarchical, hybrid, potential, or module:Class",
        ),
        ("", "no such controller"),
        ("no_such_module:Guide", "cannot be imported: ModuleNotFoundError: No module named 'no_such_module'"),
        (f"{__name__}:Gide", "cannot be imported: AttributeError: "),
        (":Guide", "cannot be imported: ValueError: "),
        (f"{__name__}:", "cannot be imported: "),
        (named(WithoutSettings), "is no controller: it lacks Settings"),
        (named(WithoutStep), "is no controller: it lacks step"),
        ("math:pi", "is no controller: it lacks Settings, step"),
        (named(WithPlainSettings), "is no controller: its Settings is no dataclass"),
    ],
)
def test_a_name_that_means_no_controller_is_one_problem(mode: str, said: str) -> None:
    """It names the key, what was found there, and what is wrong with it."""
    (problem,) = refused(mode)
    assert (problem.path, problem.found) == ("control.mode", repr(mode))
    assert problem.allowed.startswith(said)


def test_wrong_options_are_problems_of_the_control_table() -> None:
    """Every one of them, by its key."""
    assert {problem.path for problem in refused(named(Guide), pace_mps=-1, pase=2)} == {
        "control.pace_mps",
        "control.pase",
    }
    (problem,) = refused(named(Guide), pace_mps=5.0)
    assert str(problem) == "control.pace_mps: 5; at most agents.speed_mps (1) is allowed"
    (problem,) = refused("hybrid", d_min_m=20)
    assert problem.path == "control.d_min_m"


def test_a_controller_that_cannot_be_made_is_one_line() -> None:
    """With its name and what it raised."""
    with pytest.raises(ControllerError) as caught:
        make_controller(1, settings(named(Broken)))
    assert str(caught.value) == f"controller {named(Broken)} cannot be made: RuntimeError: no map of the place"


def test_an_error_is_described_in_one_line() -> None:
    """Its kind and its text, without line breaks."""
    assert described(ValueError("one\n  two")) == "ValueError: one two"
    assert described(KeyError()) == "KeyError:"
