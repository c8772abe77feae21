"""The criterion of a training: whether to train again, by a measure of the training runs so far. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deltaswarm_orchestrator.results.metrics import Outcome
from deltaswarm_orchestrator.results.run_tables import summary
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_sessions.variables import MEASURES, SITUATION_RIGHT_SHARE, value_at
from deltaswarm_wire.checked import Problem, key

GO_ON, END = "go on", "end"
OPEN, REACHED, NOT_REACHED = "open", "reached", "not reached"


@dataclass(frozen=True)
class CriterionSettings:
    """The table `[session.training.criterion]`: training is repeated until a measure of a run is within its bounds."""

    metric: str = key("", "a column of runs.tsv, or a number in summary.json by its dotted name")
    at_least: float | None = key(None, "lower bound of the metric")
    at_most: float | None = key(None, "upper bound of the metric")
    max_runs: int = key(3, "complete training runs after which the training ends in any case", low=1, high=20)
    if_not_reached: str = key(GO_ON, "go on with the runs, or end the session", choices=(GO_ON, END))

    def problems(self) -> list[Problem]:
        """Check that there is a metric with bounds that a value can meet."""
        problems = []
        if not self.metric:
            problems.append(Problem("metric", "missing", "must be a column of runs.tsv or a name in summary.json"))
        if self.at_least is None and self.at_most is None:
            problems.append(Problem("at_least", "missing", "must be given, or at_most"))
        elif self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            problems.append(Problem("at_least", f"{self.at_least:g}", f"must be at most at_most, {self.at_most:g}"))
        return problems

    def problems_with(self, scenario: Scenario) -> list[Problem]:
        """Check that the training's runs have the metric."""
        probes = scenario.operator.probes
        needs: dict[str, tuple[str, Any]] = {
            "person.isa": ("operator.probes.isa_every_s", probes.isa_every_s),
            "person.tlx.raw": ("operator.probes.tlx", probes.tlx),
            "person.tlx.weighted": ("operator.probes.tlx_weights", probes.tlx and probes.tlx_weights),
            SITUATION_RIGHT_SHARE: ("operator.probes.sagat_at_s or .spam_at_s", probes.sagat_at_s or probes.spam_at_s),
        }
        if self._path not in {variable.path for variable in MEASURES.values()} | {
            *_numbers(summary(Outcome(), scenario))
        }:
            known = f"must be a number in summary.json by its dotted name, or one of {', '.join(MEASURES)}"
            return [Problem("metric", repr(self.metric), known)]
        if self._path.startswith("task."):
            needs[self._path] = ("operator.task.target_share", scenario.operator.task.is_on)
        name, is_asked = needs.get(self._path, ("", True))
        if not is_asked:
            return [
                Problem("metric", repr(self.metric), f"must be a number that the training's runs have; it lacks {name}")
            ]
        return []

    def value(self, run: Mapping[str, Any]) -> float | None:
        """Return the metric of a run, from its summary; None if the run has none."""
        value = value_at(run, self._path)
        return float(value) if isinstance(value, int | float) else None

    def outcome(self, values: Sequence[float | None]) -> str:
        """Return REACHED, NOT_REACHED or OPEN, which means: train again.

        `values`: the metric in each complete training run so far; None, which is within no bounds, if a run has none.
        """
        if any(map(self._is_met, values)):
            return REACHED
        return NOT_REACHED if len(values) >= self.max_runs else OPEN

    @property
    def bounds(self) -> str:
        """The bounds in words."""
        ends = (("at least", self.at_least), ("at most", self.at_most))
        return " and ".join(f"{word} {bound:g}" for word, bound in ends if bound is not None)

    def _is_met(self, value: float | None) -> bool:
        return (
            value is not None
            and (self.at_least is None or value >= self.at_least)
            and (self.at_most is None or value <= self.at_most)
        )

    @property
    def _path(self) -> str:
        return MEASURES[self.metric].path if self.metric in MEASURES else self.metric


def _numbers(table: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Return the dotted names of a summary's values."""
    return [
        name
        for key, value in table.items()
        for name in (_numbers(value, f"{prefix}{key}.") if isinstance(value, Mapping) else [f"{prefix}{key}"])
    ]
