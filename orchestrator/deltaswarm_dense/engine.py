"""A run by the dense engine: blocks of steps in arrays, the chains of digests over their bytes, and its outcome."""

import hashlib
import time

import numpy as np

from deltaswarm_dense import layout
from deltaswarm_dense.layout import MAX_ORDERS, BeyondError
from deltaswarm_dense.operating import Operator
from deltaswarm_dense.results import events_of, step_records, told_s, totals_of_operator, workloads
from deltaswarm_dense.setting_up import set_up
from deltaswarm_dense.step import advance
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.engine import NOTHING_MORE, Wanted
from deltaswarm_orchestrator.run.state import RunState
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.digest import SIZE_BYTES
from deltaswarm_world.core.world import WorldCore

BLOCK_STEPS = 500
BRANCHES, BELIEFS = 16, 64
"""Room for children and for known events of an agent; a run that needs more is begun again with twice as much."""

MAX_ROOM = 4096

WORLD, OPERATOR = 0, 1
"""The digest of which part."""


def run_dense(scenario: Scenario, wanted: Wanted = NOTHING_MORE, state: RunState | None = None) -> Outcome:
    """Do a covered run, until its end; return the outcome that `run_in_process` returns. It is an `Engine`.

    Raises:
        BeyondError: the run needs what the arrays have no room for.
    """
    assert state is None, "the dense engine begins at the beginning"
    branches, beliefs = BRANCHES, BELIEFS
    while True:
        run = DenseRun(scenario, wanted, branches, beliefs)
        trouble = run.advance()
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

    def __init__(self, scenario: Scenario, wanted: Wanted, branches: int, beliefs: int) -> None:
        self._began = time.monotonic()
        self._scenario = scenario
        self._world = WorldCore(scenario)
        """For what does not change in a run that is covered, and for the base of the operator."""
        orders = MAX_ORDERS if scenario.has_commander else 0
        self._swarm = set_up(scenario, self._world.environment, branches, beliefs, orders)
        self._counts = np.zeros(scenario.run.steps, layout.COUNTS)
        self._done = 0
        self._chains = [bytes(SIZE_BYTES), bytes(SIZE_BYTES)]
        """The states of the world's and of the operator's digest."""
        self._stopped = wanted.stopped
        self._operator = Operator(scenario, self._world, wanted.folder) if scenario.has_console else None

    def advance(self) -> int:
        """Do all steps; return the trouble that ended them, 0 if there was none."""
        steps, swarm = self._scenario.run.steps, self._swarm
        while self._done < steps and not self._stopped():
            first = self._done
            swarm.output.ends[:] = 0
            block = min(BLOCK_STEPS, steps - first)
            if self._operator is not None:
                self._operator.begin(swarm, first)
                block = self._operator.steps_from(first, block)
            counts = self._counts[first : first + block]
            done = advance(swarm, first, block, steps, counts)
            if trouble := int(swarm.trouble[0]):
                return trouble
            reports = self._hash(counts[:done])
            self._done += done
            if self._operator is not None:
                self._operator.end(self._counts["reports"][: self._done], first, reports)
        return 0

    def _hash(self, counts: np.ndarray) -> list[memoryview]:
        """Add the bytes of some steps to both digests; return the operator's of each."""
        output, parts = self._swarm.output, list[memoryview]()
        for which, buffer, name in ((WORLD, output.world, "world_end"), (OPERATOR, output.operator, "operator_end")):
            data, chain = buffer.data, self._chains[which]
            ends = counts[name].tolist()
            parts = [data[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]
            for part in parts:
                if part:
                    chain = hashlib.blake2b(chain + part, digest_size=SIZE_BYTES).digest()
            self._chains[which] = chain
        return parts

    def outcome(self) -> Outcome:
        """Return what the run recorded."""
        scenario, counts, steps = self._scenario, self._counts[: self._done], self._done
        complete = steps == scenario.run.steps
        world_digest, operator_digest = (chain.hex() for chain in self._chains)
        agent_steps = scenario.agents.count * steps
        outcome = Outcome(
            step_records=step_records(scenario, counts, self._world.air.reasons),
            events=events_of(self._swarm.world.events),
            workloads=self._operator.workloads if self._operator else workloads(scenario, counts["reports"]),
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
        if self._operator is not None:
            self._operator.finish(outcome)
        return outcome
