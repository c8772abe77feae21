"""The dense engine beside the Python engine: equal outcomes, or the first message that differs."""

import dataclasses
from collections.abc import Iterator
from typing import Any
from unittest import mock

import numpy as np

from deltaswarm_dense import engine
from deltaswarm_dense.engine import DenseRun, run_dense
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.digest import HEAD, Digest

KINDS = ("act", "radio frame", "report", "command")

Message = tuple[int, int, int, bytes]
"""Step, agent, kind, and the bytes."""


def differences(scenario: Scenario) -> list[str]:
    """Name what the outcomes of both engines differ in, and the first message that differs; empty if they are equal."""
    by_python, by_dense = run_in_process(scenario), run_dense(scenario)
    found = [
        field.name for field in dataclasses.fields(Outcome) if _of(by_python, field.name) != _of(by_dense, field.name)
    ]
    if found and by_python.digest != by_dense.digest:
        found.append(first_difference(scenario))
    return found


def _of(outcome: Outcome, name: str) -> Any:
    value = getattr(outcome, name)
    return {key: one for key, one in value.items() if key != "wall_s"} if isinstance(value, dict) else value


def first_difference(scenario: Scenario) -> str:
    """Say in which step, and of which agent, the first message differs that both engines hash."""
    added: list[Message] = []

    def add(digest: Digest, step: int, agent: int, kind: int, data: bytes) -> None:
        added.append((step, agent, kind, data))

    with mock.patch.object(Digest, "add", add):
        run_in_process(scenario)
    # A report that comes through an uplink is in both digests, of the step in which it is sent and of its arrival.
    for ours, theirs in zip(sorted(set(added)), sorted(set(_dense_messages(scenario))), strict=False):
        if ours != theirs:
            step, agent, kind, _ = min(ours, theirs)
            said = [f"{name} {data.hex()}" for name, (*_, data) in (("python", ours), ("dense", theirs))]
            return f"step {step}, agent {agent}, {KINDS[kind]}: {', '.join(said)}"
    return "one engine says more than the other"


def _dense_messages(scenario: Scenario) -> Iterator[Message]:
    kept: list[bytes] = []

    real = DenseRun._close

    def keep(run: DenseRun, first: int, counts: np.ndarray) -> Any:
        output = run._swarm.output
        ends = output.world[: counts["world_end"][-1]], output.operator[: counts["operator_end"][-1]]
        kept.extend(part.tobytes() for part in ends)
        return real(run, first, counts)

    with mock.patch.object(engine.DenseRun, "_close", keep):
        run_dense(scenario)
    for data in kept:
        at = 0
        while at < len(data):
            step, agent, kind, size = HEAD.unpack_from(data, at)
            yield step, agent, kind, data[at + HEAD.size : at + HEAD.size + size]
            at += HEAD.size + size
