"""A question technique from outside is in every table of a session, by what its class says alone."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, make_dataclass, replace
from pathlib import Path
from random import Random
from typing import Any

import pytest

from deltaswarm_operator.core import probes as asking
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario import technique as base
from deltaswarm_scenario import techniques
from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_scenario.questions import FormSettings, FormTechnique, QuestionSettings
from deltaswarm_sessions import folder, observed, session
from deltaswarm_sessions.session import Attempt
from deltaswarm_wire.checked import key


@dataclass(frozen=True)
class SartSettings:
    """Its keys, whose names begin with its own."""

    sart: bool = key(False, "ask SART after the run")
    sart_every_s: float = key(0.0, "and during it [s]")


class Sart(FormTechnique):
    """SART after the run."""

    name, title, when = "sart", "SART", base.AFTER

    @classmethod
    def of(cls, settings: Any) -> Iterable[base.Technique]:
        return [cls()] if getattr(settings, "sart", False) else []

    def form(self, number: int) -> FormSettings:
        return FormSettings(self.name, "Awareness", question=(QuestionSettings("demand", "How demanding was it?"),))


class Now(Sart):
    """The same during the run."""

    name, when, wait_s = "sart now", base.DURING, 10.0

    @classmethod
    def of(cls, settings: Any) -> Iterable[base.Technique]:
        return [cls()] if getattr(settings, "sart_every_s", 0.0) else []

    def due_s(self, number: int, last_s: float, rng: Random) -> float:
        return last_s + 10.0


@pytest.fixture
def keys(monkeypatch: pytest.MonkeyPatch) -> type[Any]:
    """The keys of a run's questions, with those of the technique, which is listed as docs/EXTENDING.md says."""
    everything: Sequence[type[base.Technique]] = (*techniques.TECHNIQUES, Sart, Now)
    for module in (techniques, asking, folder):
        monkeypatch.setattr(module, "TECHNIQUES", everything)
    made = make_dataclass("Keys", [], bases=(techniques.ProbeSettings, SartSettings), frozen=True)
    monkeypatch.setattr(session, "NOTHING", made(isa_every_s=0.0))
    monkeypatch.setattr(observed, "TIMED", observed.timed(everything))
    return made


def test_it_is_asked_again_and_is_in_the_tables(keys: type[Any], tmp_path: Path) -> None:
    plain = load_scenario("smoke")
    scenario = replace(plain, operator=replace(plain.operator, probes=keys(sart=True, sart_every_s=5.0)))
    asked = [(row["probe"], row["item"], row["text"]) for row in observed.questions_of(scenario)]
    question = ("demand", "How demanding was it?")
    assert asked[-2:] == [("sart", *question), ("sart now", *question)]
    attempt = Attempt("1-A", {"complete": True}, scenario, frozenset())
    again = attempt.unanswered
    assert again is not None
    assert [one.name for one in again.techniques if one.when == base.AFTER] == ["sart"]
    assert attempt._replace(answered=frozenset({"sart"})).unanswered is None
    answer = ProbeRow("sart now", 0, "demand", 3, 10.0, 4.0, answered_utc="2026-11-26", reaction_s=2.5)
    row = {name: str(value or "") for name, value in answer._asdict().items()}
    assert observed.of_run({}, [], [row], [])["median_answer_s"] == 2.5
