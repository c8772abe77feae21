"""Explain why an agent or the operator could, or could not, hear another agent at a given time of a run.

The run is repeated in one process up to that time. The digest shows that it is the same run; its rows are compared
with those in the folder.
"""

from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import aligned
from deltaswarm_orchestrator.inspect.info import read_run
from deltaswarm_orchestrator.inspect.repeating import refuse_branch, repeated
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.keys import OPERATOR


@dataclass(frozen=True)
class LinkFindings:
    """The world's findings on one directed link in one step."""

    sender: int
    receiver: int | str
    """An agent, or OPERATOR."""
    step: int
    time_s: float
    reason: str | None
    """What cuts the link; None if only random loss, queues and delay can stop a frame."""
    findings: tuple[dict[str, Any], ...]
    """Each model's finding, in the order in which a frame passes the models; the first that cuts gives the reason."""
    outcomes: tuple[str, ...]
    """Outcomes in this step of the sender's frames or reports for this receiver, including those in flight."""
    differs_from_step: int | None
    """The first step in which the run in the folder differs; None if none does."""
    steps_in_folder: int
    """Number of steps of the run in the folder."""


def why(folder: Path, sender: int, receiver: int | str, at_s: float) -> LinkFindings:
    """Repeat a run up to a time [s], and examine the link there.

    Raises:
        NotARunError: the folder holds no readable run.
        CommandError: the run cannot be repeated: a branch, or a killed run with a person.
        SettingsError: there is no such agent, no such time in the run, or a plug-in of the run is not installed here.
    """
    _, outcome = read_run(folder)
    manifest = seal.read_sealed(folder / seal.MANIFEST)
    refuse_branch(folder, manifest)
    scenario = repeated(folder, manifest)
    _check(scenario, sender, receiver, at_s)
    return examine(scenario, sender, receiver, int(at_s / scenario.run.step_s + 1e-9), outcome.step_records)


def _check(scenario: Scenario, sender: int, receiver: int | str, at_s: float) -> None:
    count, end_s = scenario.agents.count, scenario.run.steps * scenario.run.step_s
    problems = [
        Problem(name, str(agent), f"must be an agent from 0 to {count - 1}")
        for name, agent in (("A", sender), ("B", receiver))
        if not isinstance(agent, str) and not 0 <= agent < count
    ]
    if sender == receiver:
        problems.append(Problem("B", str(receiver), "must be another agent than A"))
    if not 0 <= at_s < end_s:
        problems.append(Problem("--at", f"{at_s:.15g}", f"must be at least 0 and below {end_s:.15g} s"))
    if problems:
        raise SettingsError(problems)


def examine(scenario: Scenario, sender: int, receiver: int | str, at_step: int, rows: list[StepRecord]) -> LinkFindings:
    """Do a scenario's run up to a step, examine the link there, and compare the run with `rows`, as far as they go."""
    swarm = InProcess(scenario)
    at = receiver if isinstance(receiver, int) else None
    differs = None
    for record, _ in islice(swarm.steps(max(at_step + 1, scenario.run.steps)), at_step + 1):
        if differs is None and record.step < len(rows):
            is_last = record.step == len(rows) - 1
            differs = None if _air_of(record, is_last) == _air_of(rows[record.step], is_last) else record.step
    diagnoses, outcomes = swarm.world.explain(sender, at)
    if at is None and swarm.world.uplink is None:
        reports = swarm.operator.reports_of_closed_step  # without an uplink model, each arrives at once
        outcomes = ["arrived" for report in reports if (report.agent, report.step) == (sender, at_step)]
    findings = [diagnosis._asdict() for diagnosis in diagnoses]
    reason = next((finding["reason"] for finding in findings if finding["cuts"]), None)
    time_s = at_step * scenario.run.step_s
    return LinkFindings(sender, receiver, at_step, time_s, reason, tuple(findings), tuple(outcomes), differs, len(rows))


def _air_of(record: StepRecord, is_last: bool) -> tuple[Any, ...]:
    """Return a row's values for comparison: all except the covered area, which is not measured in every row.

    In a run's last step all agents are asked; so its row has other numbers of that, and of what controllers count.
    """
    left_out = {"covered_area_m2", *(("agents_asked", *record.metrics) if is_last else ())}
    return tuple(value for name, value in record.columns().items() if name not in left_out)


def text(answer: LinkFindings) -> str:
    receiver = "the operator" if answer.receiver == OPERATOR else f"agent {answer.receiver}"
    verdict = "could hear" if answer.reason is None else "could not hear"
    because = "" if answer.reason is None else f": {answer.reason}"
    rows = [("CUT" if finding["cuts"] else "ok", finding["reason"], finding["says"]) for finding in answer.findings]
    if not rows:
        rows = [("ok", "uplink", "there is no model: every report arrives in the step in which it is sent")]
    rows += [("", "sent", outcome) for outcome in answer.outcomes or ("nothing in this step",)]
    if answer.differs_from_step is not None:
        replay = f"differs from the run in the folder from step {answer.differs_from_step} on"
    elif answer.step >= answer.steps_in_folder:
        replay = f"goes on where the run in the folder ends, after {answer.steps_in_folder} steps"
    else:
        replay = "equals the run in the folder up to this step"
    where = "At" if answer.differs_from_step is None else "In a repetition that is another run, at"
    head = f"{where} {answer.time_s:g} s (step {answer.step}) {receiver} {verdict} agent {answer.sender}{because}"
    return f"{head}\n{aligned([*rows, ('', 'replay', replay)])}"
