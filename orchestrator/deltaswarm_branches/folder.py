"""Make the folder of a branch: a run that has come to the branching point, with a checkpoint to go on from."""

from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from deltaswarm_branches.parent import Parent
from deltaswarm_branches.plan import Difference, Plan
from deltaswarm_branches.repetition import Repetition
from deltaswarm_orchestrator.recording import PART, RECORDING, WIRE
from deltaswarm_orchestrator.results import resume
from deltaswarm_orchestrator.results.folder import RunFolder
from deltaswarm_orchestrator.results.run_tables import new_manifest
from deltaswarm_orchestrator.run.engine import Wanted
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.run.state import RunState
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.files import whole_or_none, write_whole


def prepare(
    repetition: Repetition, plan: Plan, difference: Difference, out: Path, engine: str, *, force: bool
) -> tuple[Path, Scenario]:
    """Bring the parent to the branching point, and write the folder of a run that goes on from there.

    Return the folder, from which `deltaswarm run --resume` goes on, and the branch's scenario.

    Raises:
        FolderError, OSError: the folder cannot be made.
    """
    recordings = _recordings(repetition.parent)
    scenario = plan.scenario if recordings else replace(plan.scenario, record="off")
    with RunFolder(out, force=force) as folder, whole_or_none(folder.path):
        manifest = new_manifest(scenario, engine, scenario.record)
        # Checkpoints of its own after the last step, that is, none: the one that it begins from stays.
        manifest |= {"checkpoint_steps": scenario.run.steps, "resumed": []}
        manifest[resume.BRANCH] = _entry(repetition, plan, difference)
        folder.prepare(scenario, manifest)  # only with its manifest the folder passes for a run's, to be replaced
        state = _advance(repetition, plan, folder.path)
        state.cores.world.scenario = scenario
        for name, file in recordings.items():
            write_whole(folder.path / name, file.read_bytes())
        state.write(folder.path)
        return folder.path, scenario


def _entry(repetition: Repetition, plan: Plan, difference: Difference) -> dict[str, Any]:
    """Return what a branch's manifest says about its parent and its difference."""
    return {
        "parent": repetition.parent.identity,
        "at_s": plan.at_step * repetition.parent.step_s,
        "at_step": plan.at_step,
        resume.AFTER_STEP: plan.at_step - 1,
        "repeated_from_step": repetition.from_step,
        "says": difference.text,
        "difference": difference.told,
        "later_orders": plan.later,
    }


def _advance(repetition: Repetition, plan: Plan, folder: Path) -> RunState:
    """Go on from the state that was kept, with what is different, until the step in which the world may differ."""
    scenario = repetition.parent.scenario
    has_tables = scenario.has_console or plan.scenario.has_console
    swarm = InProcess(scenario, Wanted(folder=folder if has_tables else None), repetition.state_for(plan))
    for _ in islice(swarm.steps(before=plan.before), plan.at_step - plan.turn_step):
        pass
    plan.before(swarm, plan.at_step)
    return swarm.state


def _recordings(parent: Parent) -> dict[str, Path]:
    """Return the parent's recordings, by the names that they have in the branch."""
    found = {}
    for name in (RECORDING, WIRE):
        for file in (parent.folder / f"{name}{PART}", parent.folder / name):
            if file.exists():
                found[name] = file
    return found
