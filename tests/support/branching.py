"""Runs from which branches are made, and the command that makes them."""

import json
from pathlib import Path
from typing import Any

from deltaswarm_branches.parent import Parent
from deltaswarm_branches.plan import Difference, Plan, plan
from deltaswarm_branches.repetition import Repetition, repeat
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import Reporter

AIR = ("radio.loss=0.1", "uplink={loss=0.1, latency_s=2}", "downlink={loss=0.2, latency_s=3}")
FAULTS = (
    'fault=[{kind="kill", at_s=130, agents=[1]}, {kind="restart", at_s=110, duration_s=30, agents=[2]},'
    '{kind="freeze", at_s=60, duration_s=30, agents=[3]}, {kind="sensor-noisy", at_s=150, fraction=0.5, miss=0.3}]'
)
SCRIPT = (
    'command=[{at_s=40, name="set delta", arguments={delta=1}}, {at_s=90, name="hold", arguments={for_s=40}},'
    '{at_s=120, name="hold", target="circle", numbers=[-500, -500, 1], arguments={for_s=60}}]'
)
"""The last of these orders is for agents where there is none."""


def ran(folder: Path, *sets: str, scenario: str = "smoke") -> Path:
    """A run in one process, in its folder."""
    options = [part for text in sets for part in ("--set", text)]
    assert main(["run", scenario, "--in-process", "--quiet", "--json", "--out", str(folder), *options]) == 0
    return folder


def summary_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "summary.json").read_text()))


def manifest_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "manifest.json").read_text()))


def branched(parent: Path, out: Path, *options: str) -> Path:
    """A branch made by the command, in its folder."""
    assert main(["branch", str(parent), "--out", str(out), "--quiet", "--json", *options]) == 0
    return out


def repetition_of(parent: Parent, *steps: int, difference: Difference | None = None) -> tuple[Repetition, list[Plan]]:
    """A repeated run with a plan for each step."""
    plans = [plan(parent, step, difference or Difference()) for step in steps]
    repetition = repeat(parent, [planned.turn_step for planned in plans], Reporter(), needs_console=True)
    return repetition, plans
