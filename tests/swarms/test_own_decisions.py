"""What this package's controllers decide needs no check: it passes every check that third-party decisions must pass."""

import pytest

from deltaswarm_agent.controller import Decision, checked_act
from deltaswarm_agent.core import agent_core
from deltaswarm_agent.core.agent_core import act_of
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.messages import Act
from deltaswarm_wire.operator_messages import Report, _decode_report, keep_report


@pytest.mark.parametrize("step_s", [1.0, 0.25])
@pytest.mark.parametrize("mode", ["decentralised", "hierarchical", "hybrid", "adaptive", "central", "potential"])
def test_checks_change_no_decision(mode: str, step_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = {"acts": 0, "reports": 0}

    def act(decision: Decision, step: int) -> Act:
        made = act_of(decision, step)
        assert repr(made) == repr(checked_act(decision, step))  # equal values of equal types
        seen["acts"] += 1
        return made

    def keep(data: bytes, report: Report) -> Report:
        assert repr(report) == repr(_decode_report(data))
        seen["reports"] += 1
        return keep_report(data, report)

    monkeypatch.setattr(agent_core, "act_of", act)
    monkeypatch.setattr(agent_core, "keep_report", keep)
    sets = [f"control.mode={mode}", "record=off", f"run.step_s={step_s}", "events.rate_hz=1", "agents.count=12"]
    sets += ["radio.range_m=200"] if mode == "central" else []
    swarm = InProcess(load_scenario("paper-25", sets, 3))
    for step in range(round(200 / step_s)):
        swarm.step(step, last=False)
    assert seen["acts"] > 200
    assert seen["reports"] > 0
