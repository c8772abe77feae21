"""How the dense engine joins deltaswarm: which runs it does, and that its code is compiled before the first one."""

from typing import TYPE_CHECKING

from deltaswarm_dense.coverage import not_covered
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.engine import NOTHING_MORE, Wanted
from deltaswarm_scenario.scenario import Scenario

if TYPE_CHECKING:
    from deltaswarm_orchestrator.run.state import RunState


class Dense:
    """The dense engine, a `CoveringEngine`."""

    NEEDS = ("numba",)

    def why_not(self, scenario: Scenario) -> str:
        """Return why the engine cannot do a run; empty if it can."""
        return ", ".join(not_covered(scenario))

    def __call__(self, scenario: Scenario, wanted: Wanted = NOTHING_MORE, state: "RunState | None" = None) -> Outcome:
        """Do a run. Raises UncoveredError."""
        assert state is None, "the dense engine begins at the beginning"
        from deltaswarm_dense.compiled import compile_once  # imports numba, which is slow
        from deltaswarm_dense.engine import run_dense

        compile_once("dense engine", lambda: run_dense(Scenario()))
        return run_dense(scenario, wanted)
