"""A run by the dense engine: blocks of steps in arrays, the chains of digests over their bytes, and its outcome."""

import hashlib
import time
from collections.abc import Callable

import numpy as np

from deltaswarm_dense import layout
from deltaswarm_dense.results import events_of, step_records, told_s, totals_of_operator, workloads
from deltaswarm_dense.setting_up import set_up
from deltaswarm_dense.step import advance
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.digest import SIZE_BYTES
from deltaswarm_world.core.world import WorldCore

BLOCK_STEPS = 500
BRANCHES, BELIEFS = 16, 64
"""Room for children and for known events of an agent; a run that needs more is begun again with twice as much."""

MAX_ROOM = 4096


class BeyondError(Exception):
    """The run needs what the arrays have no room for; the Python engine must do it."""


def run_dense(scenario: Scenario, stopped: Callable[[], object] = lambda: None) -> Outcome:
    """Do a covered run, until its end; return the outcome that `run_in_process` returns.

    Raises:
        BeyondError: the run needs what the arrays have no room for.
    """
    branches, beliefs = BRANCHES, BELIEFS
    while True:
        run = DenseRun(scenario, branches, beliefs)
        trouble = run.advance(stopped)
        if trouble == layout.CHILDREN and branches < MAX_ROOM:
            branches *= 2
        elif trouble == layout.KNOWN and beliefs < MAX_ROOM:
            beliefs *= 2
        elif trouble:
            raise BeyondError(layout.TROUBLE[trouble])
        else:
            return run.outcome()


class DenseRun:
    """One run in arrays."""

    def __init__(self, scenario: Scenario, branches: int, beliefs: int) -> None:
        self._began = time.monotonic()
        self._scenario = scenario
        self._world = WorldCore(scenario)
        """For what does not change in a run that is covered."""
        self._swarm = set_up(scenario, self._world.environment, branches, beliefs)
        self._counts = np.zeros(scenario.run.steps, layout.COUNTS)
        self._done = 0
        self._chains = [bytes(SIZE_BYTES), bytes(SIZE_BYTES)]
        """The states of the world's and of the operator's digest."""

    def advance(self, stopped: Callable[[], object]) -> int:
        """Do all steps; return the trouble that ended them, 0 if there was none."""
        steps = self._scenario.run.steps
        while self._done < steps and not stopped():
            counts = self._counts[self._done : self._done + BLOCK_STEPS]
            done = advance(self._swarm, self._done, len(counts), steps, counts)
            if trouble := int(self._swarm.trouble[0]):
                return trouble
            self._hash(counts[:done])
            self._done += done
        return 0

    def _hash(self, counts: np.ndarray) -> None:
        output = self._swarm.output
        for which, (buffer, name) in enumerate(((output.world, "world_end"), (output.operator, "operator_end"))):
            data, chain, begin = buffer.data, self._chains[which], 0
            for end in counts[name].tolist():
                if end > begin:
                    chain = hashlib.blake2b(chain + data[begin:end], digest_size=SIZE_BYTES).digest()
                begin = end
            self._chains[which] = chain

    def outcome(self) -> Outcome:
        """Return what the run recorded."""
        scenario, counts, steps = self._scenario, self._counts[: self._done], self._done
        complete = steps == scenario.run.steps
        world_digest, operator_digest = (chain.hex() for chain in self._chains)
        agent_steps = scenario.agents.count * steps
        return Outcome(
            step_records=step_records(scenario, counts, self._world.air.reasons),
            events=events_of(self._swarm.world.events),
            workloads=workloads(scenario, counts["reports"]),
            world=self._world.totals(complete)
            | {
                "digest": world_digest,
                "agent_steps": {"due": agent_steps, "answered": agent_steps},
                "refused_claims": int(counts["refused_claims"].sum()),
                "wall_s": time.monotonic() - self._began,
            },
            operator={"complete": complete, "digest": operator_digest}
            | totals_of_operator(scenario, counts["reports"], self._swarm.agents["sequence"]),
            told_s=told_s(self._swarm.world.events),
        )
