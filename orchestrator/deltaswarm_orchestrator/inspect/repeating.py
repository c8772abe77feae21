"""The scenario that repeats a run: what a person and the system ordered in front of a page is a script."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.recording import COMMANDS, SCENARIO
from deltaswarm_orchestrator.results import resume
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.operator_settings import OPERATOR
from deltaswarm_scenario.scenario import Scenario

WALL_TIMES = "wall_times.csv"
"""The table that a run has if there was a page, for a person, by whom it may have been commanded."""


def refuse_branch(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise CommandError if a run is a branch, whose scenario holds from its beginning on alone."""
    if resume.BRANCH in manifest:
        parent = manifest[resume.BRANCH]["parent"]["folder"]
        raise CommandError(f"RUN must be no branch itself (got {folder}, a branch of {parent})")


def repeated(folder: Path, manifest: Mapping[str, Any]) -> Scenario:
    """Return the scenario, with its plug-ins, that repeats the run in a folder.

    Raises:
        CommandError: orders of the run are not known.
        SettingsError: a plug-in is not installed here.
    """
    scenario = load_scenario(str(folder / SCENARIO))
    if not (folder / WALL_TIMES).exists():
        return scenario
    if manifest.get("digest") is None:
        raise CommandError(f"RUN must have ended in order (got {folder}, a killed run with a person)")
    orders = folder / COMMANDS
    if orders.exists():
        scenario = load_scenario(str(folder / SCENARIO), commands=orders)
    if scenario.operator.autonomy.commands:
        autonomy = dataclasses.replace(scenario.operator.autonomy, sets_delta=OPERATOR)
        scenario = dataclasses.replace(scenario, operator=dataclasses.replace(scenario.operator, autonomy=autonomy))
    return scenario
