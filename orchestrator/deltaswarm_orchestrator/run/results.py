"""Results of a run: the files of its parts, merged into tables and one summary."""

import csv
import json
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, median
from typing import Any, TypeVar

import tomli_w

from deltaswarm_orchestrator import provenance
from deltaswarm_orchestrator.recording.names import COMMANDS, DEEDS
from deltaswarm_wire import digest
from deltaswarm_wire.files import write_whole
from deltaswarm_wire.keys import WORLD
from deltaswarm_wire.operator_messages import Workload
from deltaswarm_wire.plugins import source_digest
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.truth import DROP_REASONS, UPLINK_REASONS, EventState, Tally

EVENTS_SO_FAR = "world-events.csv"
"""One row per change of an event; read if the world did not get to write `events.csv`."""

UNMERGED = ("world.csv", "world.json", "operator.csv", "operator.json", "operator-state.json", EVENTS_SO_FAR)
"""Files of world and operator that are merged into the run's tables."""

OPERATOR_TABLE, PROBES = "operator.csv", "probes.csv"
OPERATOR_COLUMNS = {name: f"operator_{name}" for name in Workload._fields if name not in ("step", "time_s")}
"""The operator's columns of `series.csv`, keyed by their names in `Workload`."""

RUNNING = "running"
"""The exit reason of a run that has not ended. A killed run keeps it: see `folder_lock.is_held`."""

MAX_NAMED = 5
"""Maximum number of agents named in a reason."""

OFTEN = 5
"""Number of sequence number resets that cannot be chance: an agent that restarts behind a dead link causes only one."""

Row = TypeVar("Row", Tally, Workload, EventState)


@dataclass
class Outcome:
    """What the parts of one run recorded."""

    tallies: list[Tally] = field(default_factory=list)
    events: list[EventState] = field(default_factory=list)
    workloads: list[Workload] = field(default_factory=list)
    world: dict[str, Any] = field(default_factory=dict)
    operator: dict[str, Any] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    """Messages for the user: agents that failed, and why."""

    @property
    def is_complete(self) -> bool:
        """Whether world and operator both reached the last step."""
        return bool(self.world.get("complete") and self.operator.get("complete"))

    @property
    def digest(self) -> str | None:
        """The run's digest; None if the world's or the operator's is missing."""
        world, operator = self.world.get("digest"), self.operator.get("digest")
        return digest.combine(world, operator) if world and operator else None


def new_manifest(scenario: Scenario, engine: str, record: str) -> dict[str, Any]:
    """Return the manifest of a run that begins: where its results come from."""
    return {
        "name": scenario.name,
        "seed": scenario.seed,
        "engine": engine,
        "record": record,
        "started": provenance.now(),
        "exit_reason": RUNNING,
        "digest": None,
        "versions": provenance.versions(),
        "commit": provenance.commit(),
        "host": provenance.host(),
        "code": provenance.code_digest(),
        "controller": {"mode": scenario.control.mode, "source": source_digest(scenario.control.mode)},
    }


def write_json(file: Path, value: Any) -> None:
    """Write a JSON file atomically."""
    write_whole(file, json.dumps(value, indent=2, allow_nan=False).encode() + b"\n")


def read_outcome(folder: Path) -> Outcome:
    """Read a run folder, merged or not, of a complete or an interrupted run."""
    if (folder / "series.csv").exists():
        rows = _table(folder / "series.csv")
        tallies = [_row(Tally, row) for row in rows]
        own = [{**row, **{name: row[column] for name, column in OPERATOR_COLUMNS.items()}} for row in rows]
        workloads = [_row(Workload, row) for row in own if row["messages"]]
    else:
        tallies = [_row(Tally, row) for row in _table(folder / "world.csv")]
        workloads = [_row(Workload, row) for row in _table(folder / "operator.csv")]
    events = _table(folder / "events.csv")
    if not events:
        events = list({row["event"]: row for row in _table(folder / EVENTS_SO_FAR)}.values())  # the newest of each
    return Outcome(
        tallies,
        [_row(EventState, row) for row in events],
        workloads,
        _json(folder / "world.json"),
        _json(folder / "operator.json"),
    )


def _json(file: Path) -> dict[str, Any]:
    return dict(json.loads(file.read_text())) if file.exists() else {}


def _table(file: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file without a last line that was cut off; empty if there is no file."""
    if not file.exists():
        return []
    text = file.read_text()
    lines = text[: text.rfind("\n") + 1].splitlines()
    return list(csv.DictReader(lines))


def _row(kind: type[Row], row: dict[str, str]) -> Row:
    return kind(*(_cell(row[name], kind.__annotations__[name]) for name in kind._fields))


def _cell(text: str, hint: Any) -> Any:
    if hint is int:
        return int(text)
    return float(text) if text else None


def write_tables(folder: Path, outcome: Outcome, *, keep_unmerged: bool = False) -> None:
    """Write `series.csv` (one row per step, with the world's and the operator's columns) and `events.csv`.

    Delete the tables of the parts, unless `keep_unmerged` is set because the run may be resumed.
    """
    by_step = {workload.step: workload for workload in outcome.workloads}

    def rows() -> Iterable[list[Any]]:
        for tally in outcome.tallies:
            workload = by_step.get(tally.step)
            yield [*tally, *(getattr(workload, name, None) for name in OPERATOR_COLUMNS)]

    header = [*Tally._fields, *OPERATOR_COLUMNS.values()]
    write_csv(folder / "series.csv", header, rows())
    write_csv(folder / "events.csv", EventState._fields, outcome.events)
    if commands := outcome.world.get("commands"):
        write_whole(folder / COMMANDS, tomli_w.dumps({"command": commands}).encode())
    if not keep_unmerged:
        for name in UNMERGED:
            (folder / name).unlink(missing_ok=True)
        if (folder / DEEDS).exists():
            (folder / DEEDS).rename(folder / OPERATOR_TABLE)


def person_tables(folder: Path) -> list[tuple[str, bytes]]:
    """Return the tables of the person's actions and answers, with their final names; empty without a person."""
    names = {DEEDS: OPERATOR_TABLE, PROBES: PROBES}
    return [(final, (folder / name).read_bytes()) for name, final in names.items() if (folder / name).exists()]


def write_csv(file: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a CSV file atomically."""
    part = file.with_name(f"{file.name}.part")
    with part.open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(header)
        table.writerows(rows)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(file)


def metrics(outcome: Outcome, step_s: float) -> dict[str, Any]:
    """Compute the metrics of an outcome. They do not depend on who recorded it; a recording gives the same."""
    tallies, workloads = outcome.tallies, outcome.workloads
    waits = [e.sensed_s - e.arrived_s for e in outcome.events if e.sensed_s is not None]
    end_s = len(tallies) * step_s
    unsensed = [end_s - e.arrived_s for e in outcome.events if e.sensed_s is None]
    covered = [t.covered_area_m2 for t in tallies if t.covered_area_m2 is not None]
    with_trees = [t.covered_area_m2 for t in tallies if t.covered_area_m2 is not None and t.trees]
    in_trees = [t.agents_in_trees for t in tallies]
    return {
        "waiting_time_s": {
            "mean": _mean(waits),
            "median": float(median(waits)) if waits else None,
            "n": len(waits),
            "never_sensed": len(unsensed),
            "mean_with_never_sensed": _mean(waits + unsensed),
        },
        "operator_messages_per_s": {"mean": _rate([w.messages for w in workloads], step_s)},
        "operator_senders": {"mean": _mean([w.senders for w in workloads])},
        "operator_time_above_threshold_s": workloads[-1].time_above_s if workloads else None,
        "frames_sent_per_s": {"mean": _rate([t.frames_sent for t in tallies], step_s)},
        "frames_received_per_s": {"mean": _rate([t.frames_received for t in tallies], step_s)},
        "bytes_sent_per_s": {"mean": _rate([t.bytes_sent for t in tallies], step_s)},
        "frames": {
            "sent": sum(t.frames_sent for t in tallies),
            "received": sum(t.frames_received for t in tallies),
            "duplicated": sum(t.frames_duplicated for t in tallies),
            "in_flight": tallies[-1].frames_in_flight if tallies else 0,
        },
        "frames_dropped": {reason: sum(getattr(t, f"dropped_{reason}") for t in tallies) for reason in DROP_REASONS},
        "reports": {
            "sent": sum(t.reports_sent for t in tallies),
            "arrived": sum(t.reports_arrived for t in tallies),
            "in_flight": tallies[-1].reports_in_flight if tallies else 0,
        },
        "reports_dropped": {
            reason: sum(getattr(t, f"reports_dropped_{reason}") for t in tallies) for reason in UPLINK_REASONS
        },
        "agents_in_trees": {"mean": _mean(in_trees), "last_third_mean": _mean(in_trees[len(in_trees) * 2 // 3 :])},
        "trees": {"mean": _mean([t.trees for t in tallies])},
        "covered_area_m2": {"mean": _mean(covered), "mean_while_trees": _mean(with_trees)},
        "transport_lost": sum(t.transport_lost for t in tallies) + sum(w.lost for w in workloads),
        "samples_rejected": sum(t.rejected for t in tallies) + sum(w.rejected for w in workloads),
        "steps": len(tallies),
    }


def _mean(values: Sequence[float]) -> float | None:
    return fmean(values) if values else None


def _rate(counts: Sequence[int], step_s: float) -> float | None:
    mean = _mean(counts)
    return None if mean is None else mean / step_s


def _lost_by_agent(outcome: Outcome) -> str:
    """Name the agents that lost most messages, most first; empty if that is not known."""
    lost = Counter({agent: own["lost"] for agent, own in (outcome.operator.get("per_sender") or {}).items()})
    lost.update(outcome.world.get("transport_lost", {}))
    named = [f"{count} of agent {agent}" for agent, count in (+lost).most_common(MAX_NAMED) if agent != WORLD]
    return f" ({', '.join(named)})" if named else ""


def summary(outcome: Outcome, scenario: Scenario) -> dict[str, Any]:
    """Return the content of `summary.json`: the metrics, and how the run went."""
    found = metrics(outcome, scenario.run.step_s)
    wall_s = outcome.world.get("wall_s")
    simulated_s = found["steps"] * scenario.run.step_s
    reasons = [] if outcome.is_complete else ["the run did not reach its last step"]
    if found["transport_lost"]:
        reasons.append(f"{found['transport_lost']} messages were lost on the fabric{_lost_by_agent(outcome)}")
    reasons += [
        f"agent {agent}'s sequence number reset {count} times; two processes may share its id"
        for agent, count in outcome.world.get("fell_back", {}).items()
        if count >= OFTEN
    ]
    reasons += [
        f"agent {agent} sent {count} samples more than one radio frame, one report and one act in a step"
        for agent, count in outcome.world.get("excess", {}).items()
    ]
    return {
        "name": scenario.name,
        "mode": scenario.control.mode,
        "seed": scenario.seed,
        **found,
        "wall_s": wall_s,
        "steps_per_s": found["steps"] / wall_s if wall_s else None,
        "real_time_factor": simulated_s / wall_s if wall_s else None,
        "digest": outcome.digest,
        "agents_lost": outcome.world.get("agents_lost", []),
        "boards": outcome.world.get("boards", {}),
        "faults": outcome.world.get("faults", []),
        "agents_late": sum(t.agents_late for t in outcome.tallies),
        "refused_claims": outcome.world.get("refused_claims"),
        "events_cut": outcome.world.get("events_cut"),
        "realtime_overruns": outcome.world.get("realtime_overruns", 0),
        "rejected_by_agent": outcome.world.get("rejected", {}),
        "excess_by_agent": outcome.world.get("excess", {}),
        "late_acts_by_agent": outcome.world.get("late_acts", {}),
        "operator": {name: outcome.operator.get(name) for name in ("messages", "steps_missed", "per_sender")},
        **({"person": person} if (person := outcome.operator.get("person")) else {}),
        "complete": outcome.is_complete,
        "valid": not reasons,
        "invalid_because": reasons,
    }
