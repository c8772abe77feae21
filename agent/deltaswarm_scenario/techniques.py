"""List every question technique: a new one is a class in a file of its own, and two entries here.

Scenario keys, the questions of a run, the tables about a person and their scores follow from this list.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from deltaswarm_scenario.isa import Isa, IsaSettings
from deltaswarm_scenario.questions import Form, FormsSettings, Sheet, SheetSettings
from deltaswarm_scenario.situation import Sagat, SagatSettings, Spam, SpamSettings
from deltaswarm_scenario.task import JudgementTask
from deltaswarm_scenario.technique import AFTER, Measure, ScoredTable, Technique
from deltaswarm_scenario.tlx import Tlx, TlxSettings
from deltaswarm_wire.checked import Problem

TECHNIQUES: tuple[type[Technique], ...] = (JudgementTask, Sheet, Sagat, Spam, Isa, Tlx, Form)
"""All techniques; of several that are due in one step, the first is asked first."""

NAMED = tuple(technique.name for technique in TECHNIQUES if technique.title)
"""The names of techniques in `probes.csv`, besides forms."""

SCORED: dict[str, ScoredTable] = {one.scored.name: one.scored for one in TECHNIQUES if one.scored}
"""The tables of answers beside the truth, by name."""


def measures(*, after_run: bool) -> tuple[Measure, ...]:
    """Return the numbers that techniques give a run: of those that ask after it, or of all others."""
    asking = [technique for technique in TECHNIQUES if (technique.when == AFTER) == after_run]
    return tuple(dict.fromkeys(measure for technique in asking for measure in technique.measures))


@dataclass(frozen=True)
class ProbeSettings(SheetSettings, FormsSettings, SpamSettings, SagatSettings, TlxSettings, IsaSettings):
    """What a person at the station is asked; the keys of the last base class come first."""

    def problems(self) -> list[Problem]:
        """Return the mistakes of all techniques. Forms have different names, which no other technique has."""
        problems = [problem for technique in TECHNIQUES for problem in technique.problems(self)]
        names = [form.name for form in self.form]
        if len({*names, *NAMED}) < len(names) + len(NAMED):
            allowed = f"must have different names, none of them {', '.join(NAMED)}"
            problems.append(Problem("form", ", ".join(names), allowed))
        return problems

    @property
    def techniques(self) -> Sequence[Technique]:
        """What a run with these settings asks, in the order of the list."""
        return [one for technique in TECHNIQUES for one in technique.of(self)]
