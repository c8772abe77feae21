"""Controllers as plug-ins: found by name, made with their own settings, and told what is wrong in one line."""

import sys
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest

from deltaswarm_agent.controller import (
    ControllerContext,
    ControllerError,
    Decision,
    Percept,
    agent_rng,
    make_controller,
)
from deltaswarm_agent.controllers.central.controller import CentralController
from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.potential import PotentialController
from deltaswarm_agent.io.process import pickled
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, SettingsError, key, load
from deltaswarm_wire.plugin_errors import MAX_DESCRIBED, described
from deltaswarm_wire.plugins import CONTROLLERS
from deltaswarm_wire.settings import AgentSettings
from tests.support.tiers import in_one_test


@dataclass(frozen=True)
class GuideSettings:
    """What a controller of somebody else's may have for options."""

    pace_mps: float = key(0.5, "how fast it walks [m/s]", above=0)

    def problems_with(self, shared: AgentSettings) -> list[Problem]:
        """It cannot walk faster than its body."""
        if self.pace_mps <= shared.speed_mps:
            return []
        return [
            Problem("pace_mps", f"{self.pace_mps:g}", f"must be at most agents.speed_mps, {shared.speed_mps:g} m/s")
        ]


class Guide:
    Settings: ClassVar[type[GuideSettings]] = GuideSettings

    def __init__(self, context: ControllerContext) -> None:
        self.context = context

    def step(self, percept: Percept) -> Decision:
        return Decision((self.context.settings.pace_mps, 0.0))


class WithoutSettings:
    """No controller."""

    def step(self, percept: Percept) -> Decision:
        return Decision()


class WithoutStep:
    """No controller."""

    Settings = GuideSettings


class WithPlainSettings(WithoutSettings):
    """No controller: its settings cannot be checked."""

    Settings: ClassVar[type[Any]] = dict


class Broken(Guide):
    """Cannot be made."""

    def __init__(self, context: ControllerContext) -> None:
        raise RuntimeError("no map\nof the place")


class Quits(Guide):
    """Ends the process that makes it."""

    def __init__(self, context: ControllerContext) -> None:
        sys.exit(0)


@dataclass(frozen=True)
class Needy:
    """An option without a default."""

    pace_mps: float


@dataclass(frozen=True)
class Strict:
    """Checks itself in a way of its own."""

    pace_mps: float = 0.5

    def __post_init__(self) -> None:
        raise ValueError("pace_mps must be\nat most 1")


@dataclass(frozen=True)
class Listed:
    """A type that no option has."""

    paces_mps: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Pathed:
    """A default that no file of settings holds."""

    map_file: Path = Path("map")


@dataclass(frozen=True)
class Moded:
    """An option that would take the place of `control.mode`."""

    mode: str = "fast"


@dataclass(frozen=True)
class Raising:
    """A check that fails."""

    pace_mps: float = 0.5

    def problems_with(self, shared: AgentSettings) -> list[Problem]:
        """Never."""
        raise KeyError("speed")


def settings(mode: str, **options: Any) -> AgentSettings:
    return load(AgentSettings, {"control": {"mode": mode, **options}})


def named(cls: type) -> str:
    return f"{__name__}:{cls.__name__}"


def refused(mode: str, **options: Any) -> list[Problem]:
    with pytest.raises(SettingsError) as caught:
        make_controller(1, settings(mode, **options))
    return caught.value.problems


@in_one_test("mode", CONTROLLERS.shipped)
def test_a_shipped_controller_is_made_by_its_short_name(mode: str) -> None:
    """The modes of the paper are one class, and so is `adaptive` but for its defaults."""
    others = {"potential": PotentialController, "central": CentralController}
    made = make_controller(1, load(AgentSettings, {"range_m": 150.0, "control": {"mode": mode}}))
    assert isinstance(made, others.get(mode, PaperController))


def test_anybodys_class_is_a_controller() -> None:
    """By `module:Class`, with its own options; it is told its agent, its mode and the agent's settings."""
    shared = settings(named(Guide), pace_mps=0.75)
    made = make_controller(5, shared)
    assert isinstance(made, Guide)
    context = made.context
    assert (context.agent, context.mode) == (5, named(Guide))
    assert (context.settings, context.shared) == (GuideSettings(0.75), shared)
    assert made.step(Percept(0, 0.0, (0.0, 0.0), (), (), [])) == Decision((0.75, 0.0))


def test_an_installed_package_names_its_controllers(monkeypatch: pytest.MonkeyPatch) -> None:
    """By entry points of the group `deltaswarm.controllers`; they are told of where a name means nothing."""
    point = EntryPoint("guide", named(Guide), CONTROLLERS.group)
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [point] if group == CONTROLLERS.group else [])
    assert isinstance(make_controller(1, settings("guide")), Guide)
    (problem,) = refused("giude")
    assert "decentralised, guide, hierarchical" in problem.allowed


@pytest.mark.parametrize(
    ("own", "options", "said"),
    [
        (Needy, {}, "TypeError: Needy.__init__() missing 1 required positional argument: 'pace_mps'"),
        (Strict, {}, "ValueError: pace_mps must be at most 1"),
        (Listed, {"paces_mps": [1.0]}, "KeyError: list[float]"),
        (Pathed, {}, "TypeError: "),
        (Moded, {}, "mode"),
        (Raising, {}, "KeyError: 'speed'"),
    ],
)
def test_settings_at_fault_are_one_problem(
    monkeypatch: pytest.MonkeyPatch, own: type, options: dict[str, Any], said: str
) -> None:
    """One line that names the controller, and no traceback."""
    monkeypatch.setattr(Guide, "Settings", own)
    (problem,) = refused(named(Guide), **options)
    assert (problem.path, problem.given) == ("control.mode", repr(named(Guide)))
    assert said in problem.allowed
    assert len(str(problem).splitlines()) == 1


def test_a_script_is_no_controller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ends by `sys.exit` as it is imported, which must not end the run as if all were well."""
    (tmp_path / "a_script_of_mine.py").write_text("import sys; sys.exit(0)")
    monkeypatch.syspath_prepend(str(tmp_path))
    (problem,) = refused("a_script_of_mine:Walk")
    assert "SystemExit: 0" in problem.allowed


def test_a_module_that_is_not_there_may_need_a_path() -> None:
    """The hint is for the module that was named, and not for one that it imports."""
    (problem,) = refused("no_such_module:Guide")
    assert "PYTHONPATH" in problem.allowed
    (problem,) = refused("math.py:Guide")
    assert "PYTHONPATH" not in problem.allowed


def test_an_agents_options_are_its_own() -> None:
    """A controller that changes them changes no other agent's, in one process as with processes."""
    scenario = load(Scenario, {"schema": 1, "control": {"mode": named(Guide), "table": {"of": "mine"}}})
    scenario.for_agent(0).control.options["table"]["of"] = "yours"
    assert scenario.for_agent(1).control.options == {"table": {"of": "mine"}}


def test_a_controllers_chance_is_its_own() -> None:
    """It follows from the agent's seed, its id and the number of its restart, and from nothing else."""
    shared = settings(named(Guide))

    def first_draw(agent: int, restart: int = 0) -> float:
        made = make_controller(agent, shared, restart)
        assert isinstance(made, Guide)
        return made.context.rng.random()

    assert first_draw(1) == first_draw(1) == agent_rng(shared.seed, 1).random()
    assert len({first_draw(1), first_draw(2), first_draw(1, 1), first_draw(1, 2)}) == 4


@in_one_test(
    ("mode", "said"),
    [
        ("hybird", "decentralised, hierarchical, hybrid, potential, or module:Class"),
        ("", "decentralised, hierarchical, hybrid, potential, or module:Class"),
        ("no_such_module:Guide", "ModuleNotFoundError: No module named 'no_such_module'"),
        (f"{__name__}:Gide", "AttributeError: "),
        (":Guide", "ValueError: "),
        (f"{__name__}:", "imported"),
        (named(WithoutSettings), "Settings"),
        (named(WithoutStep), "step"),
        ("math:pi", "Settings, step"),
        (named(WithPlainSettings), "dataclass"),
    ],
)
def test_a_name_that_means_no_controller_is_one_problem(mode: str, said: str) -> None:
    """It names the key, what was found there, and what is wrong with it."""
    (problem,) = refused(mode)
    assert problem.path == "control.mode"
    assert problem.given in (repr(mode), f"{mode!r}; did you mean 'hybrid'?")
    assert said in problem.allowed


def test_wrong_options_are_problems_of_the_control_table() -> None:
    """Every one of them, by its key."""
    paths = {problem.path for problem in refused(named(Guide), pace_mps=-1, pase=2)}
    assert paths == {"control.pace_mps", "control.pase"}
    (problem,) = refused(named(Guide), pace_mps=5.0)
    assert (problem.path, problem.given) == ("control.pace_mps", "5")
    (problem,) = refused("hybrid", d_min_m=20)
    assert problem.path == "control.d_min_m"


@pytest.mark.parametrize(("own", "said"), [(Broken, "RuntimeError: no map"), (Quits, "SystemExit: 0")])
def test_a_controller_that_cannot_be_made_is_one_line(own: type, said: str) -> None:
    """With its name and what it raised; `sys.exit` is a failure as any other: it would end a run in one process."""
    with pytest.raises(ControllerError) as caught:
        make_controller(1, settings(named(own)))
    assert named(own) in str(caught.value)
    assert said in str(caught.value)


def test_an_error_is_described_in_one_line() -> None:
    """Its kind and its text, without line breaks."""
    assert described(ValueError("one\n  two")) == "ValueError: one two"
    assert described(KeyError()) == "KeyError"


def test_an_error_is_described_whatever_it_holds() -> None:
    """A text without end, control characters for a terminal, a text that cannot be had."""

    class MuteError(Exception):
        def __str__(self) -> str:
            """Fail."""
            raise ValueError("no text")

    assert described(MuteError()).startswith("MuteError: ")
    assert described(RuntimeError("\x1b[31mred\x00")) == "RuntimeError: ?[31mred?"
    assert len(described(RuntimeError("x" * 100_000))) == MAX_DESCRIBED


def test_a_controller_that_pickle_refuses_is_named_in_one_line() -> None:
    """A traceback would have no frame but deltaswarm's own."""
    core: Any = SimpleNamespace(controller=lambda: None)
    with pytest.raises(ControllerError, match=r"cannot be saved in a checkpoint: .*Can't pickle") as error:
        pickled(core, 0)
    assert error.value.report == str(error.value)
