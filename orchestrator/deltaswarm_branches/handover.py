"""Make the folder of a branch: a run that has come to the branching point, with a checkpoint to go on from."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from deltaswarm_branches.parent import Parent
from deltaswarm_branches.plan import Difference, Plan
from deltaswarm_branches.trunk import Trunk
from deltaswarm_orchestrator.recording import PART, RECORDING, WIRE
from deltaswarm_orchestrator.results import resume
from deltaswarm_orchestrator.results.folder import RunFolder
from deltaswarm_orchestrator.results.run_tables import new_manifest
from deltaswarm_orchestrator.run import checkpoints
from deltaswarm_orchestrator.run.in_process import Begun, InProcess
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.files import whole_or_none, write_whole
from deltaswarm_wire.operator_messages import Clock


def told(parent: Parent, plan: Plan, difference: Difference, trunk: Trunk) -> dict[str, Any]:
    """Return what a branch's manifest says about its parent and its difference."""
    return {
        "parent": parent.identity,
        "at_s": plan.at_step * parent.step_s,
        "at_step": plan.at_step,
        resume.AFTER_STEP: plan.at_step - 1,
        "repeated_from_step": trunk.from_step,
        "says": difference.text,
        "difference": difference.told,
        "later_orders": plan.later,
    }


def prepare(
    parent: Parent, plan: Plan, difference: Difference, trunk: Trunk, out: Path, engine: str, *, force: bool
) -> tuple[Path, Scenario]:
    """Bring the parent to the branching point, and write the folder of a run that goes on from there.

    Return the folder, from which `deltaswarm run --resume` goes on, and the branch's scenario.

    Raises:
        FolderError, OSError: the folder cannot be made.
    """
    recordings = _recordings(parent)
    scenario = plan.scenario if recordings else _without_recording(plan.scenario)
    with RunFolder(out, force=force) as folder, whole_or_none(folder.path):
        manifest = new_manifest(scenario, engine, scenario.record)
        # Checkpoints of its own after the last step, that is, none: the one that it begins from stays.
        manifest |= {"checkpoint_steps": scenario.run.steps, "resumed": []}
        manifest[resume.BRANCH] = told(parent, plan, difference, trunk)
        folder.prepare(scenario, manifest)  # only with its manifest the folder passes for a run's, to be replaced
        begun = _advance(parent, plan, trunk, folder.path)
        begun.cores.world.scenario = scenario
        for name, file in recordings.items():
            write_whole(folder.path / name, file.read_bytes())
        checkpoints.write(folder.path, begun)
        return folder.path, scenario


def _advance(parent: Parent, plan: Plan, trunk: Trunk, folder: Path) -> Begun:
    """Go on from the state that was kept, with what is different, until the step in which the world may differ."""
    state = trunk.states[plan.turn_step]
    begun = state.begun(trunk.past)
    for name, data in state.tables.items():
        write_whole(folder / name, data)
    has_tables = parent.scenario.has_console or plan.scenario.has_console
    swarm = InProcess(parent.scenario, folder if has_tables else None, begun=begun)
    for step in range(plan.turn_step, plan.at_step):
        plan.before(swarm, step)
        record = swarm.step(step, last=False)
        begun.workloads.append(swarm.close_step(Clock(step, record.time_s, False)))
        begun.step_records.append(record)
    plan.before(swarm, plan.at_step)
    sizes = {name: len(data) for name, data in swarm.tables.items()}
    return Begun(swarm.cores, begun.step_records, begun.workloads, sizes)


def _recordings(parent: Parent) -> dict[str, Path]:
    """Return the parent's recordings, by the names that they have in the branch."""
    found = {}
    for name in (RECORDING, WIRE):
        for file in (parent.folder / f"{name}{PART}", parent.folder / name):
            if file.exists():
                found[name] = file
    return found


def _without_recording(scenario: Scenario) -> Scenario:
    return replace(scenario, record="off")
