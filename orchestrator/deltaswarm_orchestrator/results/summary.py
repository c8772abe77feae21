"""The summary of a run: its metrics, the counts of its parts, and whether its numbers may be used."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from deltaswarm_orchestrator.results.metric import Metric, OverTime
from deltaswarm_orchestrator.results.metrics import METRICS
from deltaswarm_orchestrator.results.outcome import Compute, Outcome, RunData, own_last, own_mean
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.technique import Measure
from deltaswarm_scenario.techniques import measures
from deltaswarm_scenario.truth import NOBODY_LEFT
from deltaswarm_wire.controller_metrics import STEP, declared
from deltaswarm_wire.keys import WORLD

MAX_NAMED = 5
"""Maximum number of agents named in a reason."""

NO_LINK = "its process ended, or its link to the world was cut"
"""The cause of a failure of which the world knows no more."""

HUNG_STEPS, HUNG_S = 20, 1.0
"""By the wall clock, an agent hangs that misses so many steps in a row and for so long [wall s], or for the whole of
`run.step_timeout_s`."""

OFTEN = 5
"""Number of sequence number resets that is no coincidence: an agent that restarts behind a dead link causes one."""


def of_world(name: str, default: Any = None) -> Compute:
    return lambda run: run.outcome.world.get(name, default)


def of_operator(name: str) -> Compute:
    return lambda run: run.outcome.operator.get(name)


def steps_per_s(run: RunData) -> float | None:
    wall_s = run.outcome.world.get("wall_s")
    return len(run.steps) / wall_s if wall_s else None


def real_time_factor(run: RunData) -> float | None:
    wall_s = run.outcome.world.get("wall_s")
    return len(run.steps) * run.scenario.run.step_s / wall_s if wall_s else None


def why_invalid(run: RunData) -> list[str]:
    """Return why the run's numbers may not be used; empty if they may."""
    outcome = run.outcome
    reasons = []
    if not outcome.is_complete:
        nobody = f": {NOBODY_LEFT}" if outcome.world.get("deserted") else ""
        reasons.append(f"the run did not reach its last step{nobody}")
    reasons += missing_agents(run)
    if lost := lost_on_fabric(run):
        reasons.append(f"{lost} messages were lost on the fabric{_lost_by_agent(outcome)}")
    reasons += [
        f"agent {agent}'s sequence number reset {count} times; two processes may share its id"
        for agent, count in outcome.world.get("fell_back", {}).items()
        if count >= OFTEN
    ]
    reasons += [
        f"agent {agent} sent {count} samples more than one radio frame, one report and one act in a step"
        for agent, count in outcome.world.get("excess", {}).items()
    ]
    return reasons


def failed_agents(run: RunData) -> list[dict[str, Any]]:
    """Return the agents that failed although no fault of the scenario made them fail."""
    outcome, causes = run.outcome, run.outcome.causes
    rows = {row["agent"]: row for row in outcome.world.get("agents_failed", [])}
    step = len(run.steps)
    rows = {agent: {"agent": agent, "step": step, "steps": 0, "longest": 0} for agent in causes} | rows
    return [{**row, "cause": row.get("cause") or causes.get(agent, NO_LINK)} for agent, row in sorted(rows.items())]


def hung_agents(run: RunData) -> list[dict[str, Any]]:
    """Return the agents that were there and did not answer, as `failed_agents` does.

    By the wall clock a step ends without agents that are slightly late; only those hang that miss several in a row.
    """
    settings, rows = run.scenario.run, run.outcome.world.get("agents_late", [])
    cause = f"no answer within {settings.step_timeout_s:g} s (run.step_timeout_s)"
    if settings.clock == "realtime":
        tick_s = settings.step_s / settings.real_time_factor
        longest_s = max(HUNG_S, HUNG_STEPS * tick_s)  # else a machine that is busy for a moment spoils a fast run
        least = math.ceil(min(longest_s, settings.step_timeout_s) / tick_s)
        rows = [row for row in rows if row["longest"] >= least]
        cause = f"no answer in {least} steps of {tick_s:g} s or more in a row"
    states = run.outcome.outlasted
    return [{**row, "cause": "; ".join(filter(None, [cause, states.get(row["agent"])]))} for row in rows]


def missing_agents(run: RunData) -> list[str]:
    """Name the agents that missed a part of the run, unless the scenario accepts as many."""
    rows = [("failed", row) for row in failed_agents(run)] + [("hung", row) for row in hung_agents(run)]
    agents = {row["agent"] for _, row in rows}
    if run.scenario.run.accepts_lost(len(agents), run.scenario.agents.count):
        return []
    reasons = [
        f"agent {row['agent']} {what} in step {row['step']} ({row['steps']} steps missed): {row['cause']}"
        for what, row in rows[:MAX_NAMED]
    ]
    left = agents - {row["agent"] for _, row in rows[:MAX_NAMED]}
    return reasons + ([f"{len(left)} more agents failed or hung"] if left else [])


def answered_share(run: RunData) -> float | None:
    counts = run.outcome.world.get("agent_steps")
    return counts["answered"] / counts["due"] if counts and counts["due"] else None


def lost_on_fabric(run: RunData) -> int:
    [metric] = [metric for metric in METRICS if metric.key == "transport_lost"]
    assert metric.compute is not None
    return int(metric.compute(run))


def _lost_by_agent(outcome: Outcome) -> str:
    """Name the agents that lost most messages, most first; empty if that is not known."""
    lost = Counter({agent: counts["lost"] for agent, counts in (outcome.operator.get("per_sender") or {}).items()})
    lost.update(outcome.world.get("transport_lost", {}))
    named = [f"{count} of agent {agent}" for agent, count in (+lost).most_common(MAX_NAMED) if agent != WORLD]
    return f" ({', '.join(named)})" if named else ""


ORIGIN = (
    Metric("name", "of the scenario", compute=lambda run: run.scenario.name),
    Metric("mode", "the scenario's `control.mode`", compute=lambda run: run.scenario.control.mode),
    Metric("seed", "of the scenario", compute=lambda run: run.scenario.seed),
)

ACCOUNT = (
    Metric("wall_s", "wall time of the run", "s", of_world("wall_s")),
    Metric("steps_per_s", "speed of the run", "1/s", steps_per_s, label="speed"),
    Metric("real_time_factor", "simulated time per wall time", compute=real_time_factor),
    Metric(
        "digest",
        "hash over all acts, radio frames, reports and delivered commands; equal for equal runs",
        compute=lambda run: run.outcome.digest,
        label="digest",
    ),
    Metric(
        "events_digest",
        "hash over all events: place, arrival, first sensing, first work, completion and work done, by the world",
        compute=lambda run: run.outcome.events_digest,
    ),
    Metric(
        "agent_steps.due",
        "agent-steps of which an answer is due: all of the steps done that no fault of the scenario takes",
        compute=lambda run: run.outcome.world.get("agent_steps", {}).get("due"),
    ),
    Metric(
        "agent_steps.answered",
        "those with an answer in time; the last act counts while it holds",
        compute=lambda run: run.outcome.world.get("agent_steps", {}).get("answered"),
    ),
    Metric("agent_steps.answered_share", "their share", compute=answered_share, label="agent-steps answered"),
    Metric(
        "agents_failed",
        "agents whose controller raised, or whose process or link ended, by no fault of the scenario: first `step`, "
        "`steps` missed, the `longest` time of it in steps, `cause`",
        compute=failed_agents,
    ),
    Metric("agents_hung", "agents that were there and did not answer, in the same way", compute=hung_agents),
    Metric("agents_lost", "agents that failed, once for each time", compute=of_world("agents_lost", [])),
    Metric("boards", "agents on boards, with what is known of each", compute=of_world("boards", {})),
    Metric("faults", "injected faults", compute=of_world("faults", [])),
    Metric("agents_late", "late answers", compute=lambda run: sum(record.agents_late for record in run.steps)),
    Metric("refused_claims", "observed events out of sensing range", compute=of_world("refused_claims")),
    Metric("events_cut", "sensed events that did not fit into a frame", compute=of_world("events_cut")),
    Metric("realtime_overruns", "steps that took longer than real time", compute=of_world("realtime_overruns", 0)),
    Metric("rejected_by_agent", "messages that broke the protocol, by sender", compute=of_world("rejected", {})),
    Metric("excess_by_agent", "excess samples, by sender", compute=of_world("excess", {})),
    Metric("late_acts_by_agent", "late acts, by sender", compute=of_world("late_acts", {})),
    Metric("operator.messages", "reports that the operator counted", compute=of_operator("messages")),
    Metric("operator.steps_missed", "steps that the operator missed", compute=of_operator("steps_missed")),
    Metric(
        "operator.per_sender", "`messages`, `lost` and `rejected` of each sender", compute=of_operator("per_sender")
    ),
)
"""What the parts counted, and how the run went."""


def _of_person(name: str, meaning: str, unit: str = "", **more: Any) -> Metric:
    return Metric(f"person.{name}", meaning, unit, **more)


_SECONDS = {"unit": "s", "is_whole": False}


def _of_technique(measure: Measure) -> Metric:
    return Metric(
        measure.key,
        measure.meaning,
        title=measure.title,
        study=measure.key.replace(".", "_") if measure.title else "",
        session=measure.column,
        is_in_summary=measure.is_in_summary,
        is_whole=measure.is_whole,
    )


_INBOX: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("items", "messages in the inbox: those that tell something new of their sender or, with `repeats`, all", {}),
    ("shown", "items that the inbox showed", {}),
    ("lines", "lines on which the inbox showed items", {"title": "Lines of the inbox", "study": "inbox_lines"}),
    ("held_back", "items that were not shown when they arrived", {"title": "Items held back", "study": "inbox_held"}),
    ("never_shown", "items that were never shown", {"title": "Items never shown", "study": "inbox_never_shown"}),
    ("opened", "items that the person opened while they were held back", {}),
    ("read", "items that were read, also as one of several on a line", {}),
    ("unread", "shown items that ask to be read and were not, at the end", {}),
    ("shown_after_s", "mean time from an item's arrival until it was shown", _SECONDS),
    ("read_after_s", "mean time from an item's arrival until it was read, of those that were read", _SECONDS),
    ("alerts", "items of severity alert", {"title": "Alerts", "study": "inbox_alerts"}),
    ("alerts_never_shown", "alerts that were never shown", {}),
    ("alerts_shown_after_s", "mean time from an alert's arrival until it was shown", _SECONDS),
    (
        "alerts_read_after_s",
        "mean time from an alert's arrival until it was read, of those that were read",
        {**_SECONDS, "title": "Time from an alert's arrival until it is read", "study": "alerts_read_after"},
    ),
    (
        "alerts_missed",
        "alerts that were not read within `operator.person.patience_s` of their arrival",
        {"title": "Alerts missed", "study": "alerts_missed"},
    ),
    (
        "alerts_missed_share",
        "share of alerts that were not read within `operator.person.patience_s`, of those that arrived early enough",
        {"title": "Share of alerts missed", "study": "alerts_missed_share", "is_whole": False},
    ),
)
"""Name, meaning and more of each metric of the inbox."""

PERSON = (
    _of_person(
        "utilisation",
        "share of time in which the person is busy",
        title="Share of the time in which the operator is busy",
        study="person_utilisation",
    ),
    _of_person(
        "load", "mean of the load x, from 0 to 1", title="Mean load of the operator, from 0 to 1", study="person_load"
    ),
    _of_person(
        "load_above_0_7_s", "time with x above 0.7", "s", title="Time at a load above 0.7", study="person_high_load"
    ),
    _of_person("items", "items of the inbox", session="items", is_whole=True),
    _of_person("read", "items that were read", session="read", is_whole=True),
    _of_person(
        "missed",
        "items that were unread for too long",
        title="Items missed",
        study="person_missed",
        session="missed",
        is_whole=True,
    ),
    _of_person("missed_share", "items that were unread for too long, as a share of all", session="missed_share"),
    _of_person("replaced", "items that a newer item replaced before they were read", is_whole=True),
    _of_person("unread.mean", "unread items at the ends of steps", title="Unread items", study="person_unread"),
    _of_person("unread.max", "the same, most", is_whole=True),
    _of_person("unread.last", "the same, at the end of the run", is_whole=True),
    _of_person(
        "acknowledge_s",
        "mean time until an item was read",
        "s",
        title="Time until an item is read",
        study="person_acknowledge",
        session="acknowledge_s",
    ),
    _of_person(
        "commands", "commands given", title="Commands", study="person_commands", session="commands", is_whole=True
    ),
    _of_person("commands_by_state.done", "commands carried out by an agent", session="commands_done", is_whole=True),
    _of_person("commands_by_state", "commands by outcome at the end: sent, heard, done or expired"),
    *map(_of_technique, measures(after_run=False)),
    _of_person("questions", "questions asked", session="questions", is_whole=True),
    _of_person(
        "answers_missing", "questions that the person left unanswered", session="answers_missing", is_whole=True
    ),
    _of_person(
        "questions_lost",
        "planned questions that were not asked, or that the end of the run or a restart cut off",
        session="questions_lost",
        is_whole=True,
    ),
    _of_person("page_away_s", "wall time in which no page of the participant answered", "s", session="page_away_s"),
    *map(_of_technique, measures(after_run=True)),
    _of_person("interaction_s", "mean time spent on an item", "s"),
    _of_person(
        "between_items_s", "mean time from the end of an item to the beginning of the next item of the same agent", "s"
    ),
    _of_person(
        "agents_in_turn",
        "`between_items_s` / `interaction_s` + 1: agents whose items the person could read in turn",
        title="Agents whose items could be read in turn",
        study="person_agents_in_turn",
    ),
    Metric("inbox.policy", "the scenario's `operator.inbox.policy`"),
    *(Metric(f"inbox.{name}", meaning, **{"is_whole": True, **more}) for name, meaning, more in _INBOX),
    Metric("autonomy.changes", "orders of the system that differ from its last one", is_whole=True),
    Metric("autonomy.vetoes", "vetoes of the person against them", is_whole=True),
)
"""What the operator's process and the person's tables tell of a person at the console, if there was one."""

VALIDITY = (
    Metric("complete", "whether all steps are there", compute=lambda run: run.outcome.is_complete),
    Metric("valid", "whether the numbers may be used", compute=lambda run: not why_invalid(run), label="valid"),
    Metric("invalid_because", "if not, why", compute=why_invalid),
)

ENDING = (
    Metric("exit_reason", "how the run ended"),
    Metric("why", "which parts ended early and how"),
    Metric("operator_restarts", "restarts of the operator", is_whole=True),
    Metric("resumed", "where the run was resumed"),
)
"""What the run's manifest has, too."""

EVERY_KEY = (*ORIGIN, *METRICS, *ACCOUNT, *PERSON, *VALIDITY, *ENDING)
"""Every key of the summary."""


def summarise(outcome: Outcome, scenario: Scenario) -> dict[str, Any]:
    """Return the content of `summary.json`: the metrics, and how the run went."""
    run = RunData(outcome, scenario)
    by_operator = {name: told for name in ("person", "inbox", "autonomy") if (told := outcome.operator.get(name))}
    own = controllers_own(scenario.control.mode)
    return computed(run, (*ORIGIN, *METRICS, *own, *ACCOUNT)) | by_operator | computed(run, VALIDITY)


def controllers_own(mode: str) -> tuple[Metric, ...]:
    """Return the metrics that the controller of `control.mode` declares."""
    return tuple(
        Metric(
            one.key,
            one.meaning,
            one.unit,
            own_mean(one.name) if one.per == STEP else own_last(one.name),
            title=one.meaning,
            study=one.key,
            over=OverTime(one.column),
        )
        for one in declared(mode)
    )


def computed(run: RunData, metrics: tuple[Metric, ...] = METRICS) -> dict[str, Any]:
    """Compute metrics, keyed by their names; a name with a dot is a key within a key."""
    values: dict[str, Any] = {}
    for metric in metrics:
        if metric.compute is not None:
            above, _, name = metric.key.rpartition(".")
            (values.setdefault(above, {}) if above else values)[name] = metric.compute(run)
    return values


def value_at(summary: Mapping[str, Any], key: str) -> Any:
    """Return what a summary has at a dotted name; None if it has nothing there."""
    value: Any = summary
    for name in key.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


def main_rows(summary: Mapping[str, Any]) -> Iterator[tuple[str, Any, str]]:
    """Yield the summary's main metrics: label, value, unit; each reason of drops as well.

    A mean as large as the horizon is shown as no less than that.
    """
    horizon_s = summary.get("horizon_s")
    yield from ((name.replace("_", " "), value, "") for name, value in summary.get("controller", {}).items())
    for metric in EVERY_KEY:
        if metric.label:
            value = value_at(summary, metric.key)
            is_at_ceiling = metric.is_restricted and value is not None and value == horizon_s
            yield metric.label, f"> {value:g}" if is_at_ceiling else value, metric.unit
        if metric.key == "reports_dropped":
            reasons: dict[str, int] = summary[metric.key]
            yield from ((f"reports dropped: {reason}", count, "") for reason, count in reasons.items() if count)
