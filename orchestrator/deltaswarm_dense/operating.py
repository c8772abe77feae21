"""The console of a run in which it gives no orders: it takes in the reports after the run, step by step."""

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path

from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.operating import Operating
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.operator_messages import Clock, Report, decode_report

HEAD = struct.Struct("<IHBI")
"""The head of a message in the digest: step, agent, kind, length [bytes]."""


def messages_of(data: bytes) -> Iterator[bytes]:
    """Yield the messages that a digest hashes, which come with their heads."""
    at = 0
    while at < len(data):
        *_, size = HEAD.unpack_from(data, at)
        at += HEAD.size + size
        yield data[at - size : at]


def operate(scenario: Scenario, folder: Path | None, outcome: Outcome, messages: Iterable[Iterable[bytes]]) -> None:
    """Let the console take in the messages of each step; complete the outcome. See `InProcess.close_step`."""
    operating, last_step = Operating(scenario, folder), len(outcome.workloads) - 1
    for workload, arrived in zip(outcome.workloads, messages, strict=True):
        reports: list[Report] = list(map(decode_report, arrived))
        operating.close_step(Clock(workload.step, workload.time_s, workload.step == last_step), workload, reports)
    operating.finish(outcome)
