"""All cores in one process: what they hand to one another is what the bytes would have told them."""

import re
from typing import Any

import pytest

from deltaswarm_agent.controllers.potential import PotentialController
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.envelope import decode_sample
from deltaswarm_wire.messages import decode_act
from deltaswarm_wire.operator_messages import decode_report
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
    assert re.search("potential .*OSError: the map", message)
    assert len(outcome.step_records) == 5
    assert not outcome.is_complete
