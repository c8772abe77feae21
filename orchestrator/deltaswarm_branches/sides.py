"""One side of a comparison: go on from a state of the parent, with a difference or without, by any chance."""

from deltaswarm_branches.chance import Chance
from deltaswarm_branches.parent import Parent
from deltaswarm_branches.plan import Plan
from deltaswarm_branches.trunk import Trunk
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process


def go_on(parent: Parent, plan: Plan, trunk: Trunk, seed: int | None = None) -> Outcome:
    """Do the rest of a run from its branching point; with a seed, all chance from that step on is drawn by it."""
    state = trunk.states[plan.turn_step]
    if seed is None:
        return run_in_process(parent.scenario, begun=state.begun(trunk.past), before=plan.before)
    chance = Chance(seed)

    def before(swarm: InProcess, step: int) -> None:
        plan.before(swarm, step, seed)
        if step == plan.at_step:
            swarm.world.redraw(seed)
        if step >= plan.at_step:
            chance.begin_step(step)

    return run_in_process(parent.scenario, begun=state.begun(trunk.past, chance.load), before=before)
