"""All cores in one process: what they hand to one another is what the bytes would have told them."""

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest

from deltaswarm_agent.controller import ControllerError, Decision, Percept
from deltaswarm_agent.controllers.potential import PotentialController
from deltaswarm_orchestrator.live.observers import Guarded, Seen
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.envelope import decode_sample
from deltaswarm_wire.messages import decode_act
from deltaswarm_wire.operator_messages import decode_report
from deltaswarm_wire.plugins import OBSERVERS, NoSettings, find
from tests.support.cores import play, swarm


@pytest.mark.parametrize("mode", ["decentralised", "hierarchical", "hybrid"])
def test_nothing_is_handed_over_that_decoding_would_not_give(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame, act and report is what its bytes decode to, down to the types of its numbers."""
    crew = swarm("smoke", f"control.mode={mode}", "events.rate_hz=0.5", seed=3)
    handed: dict[str, int] = {}

    def check(owner: Any, name: str, decode: Any) -> None:
        take = getattr(owner, name)

        def checked(agent: int, message: Any, data: bytes) -> str | None:
            handed[name] = handed.get(name, 0) + 1
            assert repr(decode(data)) == repr(message)
            answer: str | None = take(agent, message, data)
            return answer

        monkeypatch.setattr(owner, name, checked)

    check(crew.world.intake, "accept_radio", lambda data: decode_sample(data).counter)
    check(crew.world.intake, "accept_act", decode_act)
    check(crew.world.intake, "accept_report", decode_report)
    asked = sum(record.agents_asked for record in play(crew, 200))
    assert handed["accept_act"] == asked
    assert min(handed["accept_radio"], handed["accept_report"]) > 100
    assert not crew.world.intake.rejected


def test_a_controller_that_fails_as_it_is_started_anew_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """With its line, and with what there is of the run until then; as processes do."""
    restart = 'fault=[{kind="restart", at_s=5, agents=[2]}]'
    scenario = load_scenario("smoke", ["control.mode=potential", "run.duration_s=10", "record=off", restart])
    made: list[int] = []
    make = PotentialController.__init__

    def make_once(self: PotentialController, context: Any) -> None:
        if context.agent in made:
            raise OSError("the map is in use")
        made.append(context.agent)
        make(self, context)

    monkeypatch.setattr(PotentialController, "__init__", make_once)
    outcome = run_in_process(scenario)
    [message] = outcome.messages
    assert re.search("agent 2: .*potential .*OSError: the map", message)
    reasons = summarise(outcome, scenario)["invalid_because"]
    assert any(reason.startswith("agent 2 failed in step 5 ") for reason in reasons)
    assert len(outcome.step_records) == 5
    assert not outcome.is_complete


PLUGIN = """
from deltaswarm_agent.controller import Decision
from deltaswarm_wire.plugins import NoSettings
from deltaswarm_world.core.faults.kind import Kind

ERROR = None


def fail():
    raise ERROR


class Calls:
    Settings = NoSettings

    def __init__(self, context):
        pass

    def step(self, percept):
        return Decision(payload=b"x")


class Fog:
    reason, meaning, holds_for_step = "fog", "fog", False

    @classmethod
    def of(cls, context):
        return cls()

    def cuts(self, links, time_s):
        if time_s >= 8.0:
            fail()

    def explain(self, links, time_s):
        fail()


class Wind(Kind):
    def drive(self, velocities_mps):
        fail()


class Watcher:
    shows = "nothing"
    looks = 0

    def __init__(self, connect, scenario):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *error):
        fail()

    def look(self, seen):
        Watcher.looks += 1
        fail()
"""

RAISED = [
    TimeoutError("late"),
    BrokenPipeError(32, "Broken pipe"),
    OSError(28, "No space left on device"),
    StopIteration(),
    SystemExit(0),
    KeyError("x"),
    SettingsError([]),
    ControllerError("mine"),
]


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A module with a controller, a radio model, a fault and an observer, which raise its `ERROR`."""
    (tmp_path / "raising_plugin.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("raising_plugin")
    del sys.modules["raising_plugin"]


@pytest.mark.parametrize("error", RAISED, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize(
    ("own", "steps"),
    [
        ('radio.models={"raising_plugin:Fog"={}}', 4),
        ('fault=[{kind="raising_plugin:Wind", at_s=6, agents=[1]}]', 3),
    ],
)
def test_a_radio_model_that_raises_ends_the_run_with_its_own_error(
    plugin: Any, own: str, steps: int, error: BaseException
) -> None:
    """So does a fault, whatever they raise; the steps before are kept."""
    plugin.ERROR = error
    own_code = ["control.mode=raising_plugin:Calls", own]
    outcome = run_in_process(load_scenario("smoke", [*own_code, "run.step_s=2.0", "run.duration_s=20", "record=off"]))
    (message,) = outcome.messages
    assert message.startswith("raising_plugin:")
    assert type(error).__name__ in message
    assert len(outcome.step_records) == steps
    (trace,) = outcome.traces.values()
    assert trace.splitlines()[1].endswith(("in cuts", "in drive"))
    assert "in_process.py" not in trace
    assert not outcome.is_complete


@pytest.mark.parametrize("error", RAISED, ids=lambda error: type(error).__name__)
def test_an_observer_that_raises_changes_no_run(plugin: Any, error: BaseException) -> None:
    """It is shown no more; its error is told, and once more that of its end."""
    plugin.ERROR = error
    said: list[str] = []
    find(OBSERVERS, "raising_plugin:Watcher", "--live")
    with Guarded(plugin.Watcher("", None), said.append) as observer:
        for _ in range(3):
            observer.look(Seen())
    assert plugin.Watcher.looks == 1
    assert [type(error).__name__ in text for text in said] == [True, True]
    assert "raising_plugin.py" in said[0]


class Failing:
    """A controller that fails as it is told: the agents, the step, and what it raises or returns then."""

    agents: ClassVar[set[int]] = set()
    at: ClassVar[int] = 0
    what: ClassVar[Any] = ValueError("the map is empty")

    def __init__(self, context: Any) -> None:
        self._agent = context.agent
        if self.at < 0:
            self._fail()

    Settings: ClassVar[type[Any]] = NoSettings

    def step(self, percept: Percept) -> Any:
        """Stand still, or fail."""
        return self._fail() if percept.step == self.at else Decision()

    def _fail(self) -> Any:
        if self._agent not in self.agents:
            return Decision()
        if isinstance(self.what, BaseException):
            raise self.what
        return self.what


def failing(monkeypatch: pytest.MonkeyPatch, agents: set[int], at: int, what: Any, *more: str) -> dict[str, Any]:
    """The summary of a run of 30 steps and 6 agents, some of which fail."""
    for name, value in {"agents": agents, "at": at, "what": what}.items():
        monkeypatch.setattr(Failing, name, value)
    own = [f"control.mode={__name__}:Failing", "run.duration_s=15", "run.step_s=0.5", "record=off", *more]
    scenario = load_scenario("smoke", own)
    return summarise(run_in_process(scenario), scenario)


BOOM = ValueError("the map is empty")


@pytest.mark.parametrize(
    ("agents", "at", "what", "due", "answered"),
    [
        ({2}, 0, BOOM, 180, 150),
        ({2}, 5, BOOM, 180, 155),
        ({2}, 29, BOOM, 180, 179),
        ({0, 1, 2, 3, 4}, 5, BOOM, 180, 55),
        (set(range(6)), 0, BOOM, 6, 0),
        (set(range(6)), 5, BOOM, 36, 30),
        (set(range(6)), 29, BOOM, 180, 174),
        ({2}, 5, SystemExit(0), 180, 155),
        ({2}, 5, KeyError(3), 180, 155),
        ({2}, 5, None, 180, 155),
        ({2}, 5, Decision(velocity=(float("nan"), 0.0)), 180, 155),
        ({2}, 5, "nonsense", 180, 155),
    ],
)
def test_a_run_whose_controllers_fail_is_not_valid(
    monkeypatch: pytest.MonkeyPatch, agents: set[int], at: int, what: Any, due: int, answered: int
) -> None:
    """Each is named with its step; if all fail, the run ends in that step."""
    summary = failing(monkeypatch, agents, at, what)
    counts = summary["agent_steps"]
    assert (counts["due"], counts["answered"]) == (due, answered)
    assert {(row["agent"], row["step"]) for row in summary["agents_failed"]} == {(agent, at) for agent in agents}
    assert f"failed in step {at}" in summary["agents_failed"][0]["cause"]
    named = [reason for reason in summary["invalid_because"] if f" failed in step {at} " in reason]
    assert len(named) == min(5, len(agents))
    is_deserted = len(agents) == 6
    assert summary["steps"] == (at + 1 if is_deserted else 30)
    assert ("no agent was left" in summary["invalid_because"][0]) == (is_deserted and at < 29)


def test_a_run_whose_controller_cannot_be_made_names_its_agent(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is no step."""
    reasons = failing(monkeypatch, {4}, -1, BOOM)["invalid_because"]
    assert reasons[0] == "the run did not reach its last step"
    assert reasons[1].startswith("agent 4 failed in step 0 (0 steps missed): ")


def test_failures_within_what_the_scenario_accepts_leave_a_run_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are counted and named all the same."""
    summary = failing(monkeypatch, {1, 4}, 5, BOOM, "run.accept_lost=0.34")
    assert (summary["valid"], summary["agent_steps"]["answered"]) == (True, 130)
    assert [row["agent"] for row in summary["agents_failed"]] == [1, 4]


def test_faults_of_the_scenario_take_no_validity(monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent that is killed before it would fail misses nothing; all that are killed do not end the run."""
    kill = 'fault=[{kind="kill", at_s=2, agents=[2]}]'
    summary = failing(monkeypatch, {2}, 5, BOOM, kill)
    assert (summary["valid"], summary["agent_steps"]["due"], summary["agent_steps"]["answered"]) == (True, 154, 154)
    all_of_them = failing(monkeypatch, set(), 5, BOOM, 'fault=[{kind="kill", at_s=2, fraction=1.0}]')
    assert (all_of_them["valid"], all_of_them["steps"], all_of_them["agent_steps"]["due"]) == (True, 30, 24)


def test_a_swarm_of_which_a_fault_starts_some_again_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Although nobody is left in between."""
    restart = 'fault=[{kind="restart", at_s=5, agents=[2]}]'
    summary = failing(monkeypatch, set(range(6)), 5, BOOM, restart)
    assert (summary["steps"], summary["agent_steps"]["answered"]) == (30, 6 * 5 + 20)
