"""What the world's own models decide between the steps of a run in arrays: faults, motion, the air, and the uplink.

These are the Python engine's objects, so that every model does here what it does there, with the same draws.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from deltaswarm_dense.hearing import SENDER, SLOT
from deltaswarm_dense.layout import BUFFER, OLD_FRAME, Swarm
from deltaswarm_dense.operating import messages_of
from deltaswarm_dense.setting_up import begin_again
from deltaswarm_dense.states import ROOT_ROLE
from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import UPLINK_REASONS
from deltaswarm_wire.operator_messages import Clock, Workload, read_own_report
from deltaswarm_wire.orders import KILL, START
from deltaswarm_world.core.air.reception import Reception
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.faults.timeline import Faults
from deltaswarm_world.core.uplink.uplink import Uplink
from deltaswarm_world.core.world import WorldCore


class Frame(bytes):
    """A radio frame on its way, with the step in which it was sent."""

    step: int


def is_modelled(scenario: Scenario) -> bool:
    """Whether a run needs models that only Python has."""
    radio = scenario.radio
    return bool(scenario.fault) or radio != type(radio)(range_m=radio.range_m, loss=radio.loss)


class Models:
    """The models of one run; `begin` is called before each step, `end` after it."""

    def __init__(self, scenario: Scenario, world: WorldCore) -> None:
        count = scenario.agents.count
        self._scenario, self._world = scenario, world
        self._faults = Faults(scenario) if scenario.fault else None
        self._present = set(range(count))
        self._restarts: Counter[int] = Counter()
        self._transmitted: dict[int, bytes] = {}
        self._reception = Reception(0)
        radio, width = scenario.radio, scenario.radio.bandwidth
        self._is_late = radio.latency_s + radio.jitter_s + radio.duplication > 0 or width != type(width)()
        """Whether a frame may arrive in a later step than the next, or with others of its sender."""
        self._taking_part = count
        self.listening = [True] * count
        """Whether each agent has a working receiver in this step."""
        self.agent_steps = 0
        """Those in which an agent had to answer."""
        self.reports_before = np.zeros(count, np.int64)
        """Reports of each agent's earlier processes."""
        self.records: list[dict[str, Any]] = []
        """What the models change in the world's record of each step."""
        self._no_frames = dict.fromkeys(world.air.reasons, 0)

    @property
    def faults(self) -> list[dict[str, Any]]:
        """Each fault that has begun."""
        return list(self._faults.log) if self._faults else []

    def begin(self, swarm: Swarm, step: int) -> int:
        """Begin and end faults, move bodies, carry the frames of the step before; return the trouble, if there is."""
        faults, agents, environment = self._faults, swarm.agents, self._world.environment
        if faults is not None:
            self._inject(swarm, faults, step)
        if step > 0:
            velocities_mps = np.stack([agents["vx_mps"], agents["vy_mps"]], axis=1)
            if faults is not None:
                faults.drive(velocities_mps)
            active = faults.active if faults is not None else ()
            environment.positions_m = environment.dynamics.move(environment.positions_m, velocities_mps, active)
            agents["x_m"], agents["y_m"] = environment.positions_m.T
        time_s, mute = step * self._scenario.run.step_s, faults.mute if faults is not None else ()
        self._reception = self._world.air.carry(
            step, time_s, self._transmitted, environment.positions_m, self.listening, mute
        )
        return self._deliver(swarm, self._reception, step)

    def _inject(self, swarm: Swarm, faults: Faults, step: int) -> None:
        """Do what `WorldCore.inject` and `begin` do."""
        participants, agents = self._world.participants, swarm.agents
        is_root = agents["has_status"] & (agents["role"] == ROOT_ROLE)
        for order in faults.inject(step, participants.present, np.flatnonzero(is_root).tolist()):
            for agent in order.agents:
                agents["until"][agent] = 0
                if order.action == KILL:
                    participants.kill(agent)
                    _stop(agents, agent)
                elif order.action == START:
                    participants.token_back(agent)
                    self._restarts[agent] += 1
                    self.reports_before[agent] += agents["sequence"][agent]
                    begin_again(self._scenario, swarm, agent, self._restarts[agent], step)
        participants.freeze(faults.frozen)
        participants.returned.clear()
        for agent in participants.present ^ self._present:
            agents["until"][agent] = 0
            _stop(agents, agent)
        self._present = participants.present
        taking_part = set(participants.taking_part())
        takes_part = [agent in taking_part for agent in range(len(agents))]
        self._taking_part = len(taking_part)
        self.listening = [there and agent not in faults.deaf for agent, there in enumerate(takes_part)]
        agents["takes_part"], agents["sees"] = takes_part, faults.seeing(takes_part)
        agents["until"][list(faults.affected)] = 0

    def _deliver(self, swarm: Swarm, reception: Reception, step: int) -> int:
        """Write what the models let through; return the trouble, if there is any."""
        air, slots = swarm.air, swarm.air.frames.shape[0]
        links = np.array(reception.links, np.int64).reshape(-1, 2)
        if len(links) > len(air.carried):
            return BUFFER
        air.carried[: len(links), SENDER] = links[:, 0]
        np.cumsum(np.bincount(links[:, 1], minlength=len(swarm.agents)), out=air.begins[1:])
        sent_in = (step - 1) % slots
        if self._is_late:
            frames: list[Any] = [frame for heard in reception.heard for _, frame in heard]
            if any(step - frame.step >= slots for frame in frames):
                return OLD_FRAME
            sent_in = np.array([frame.step % slots for frame in frames], np.int64)
        air.carried[: len(links), SLOT] = sent_in
        return 0

    def end(self, swarm: Swarm, count: Any, step: int) -> None:
        """After a step, take the frames that agents sent."""
        air, data = swarm.air, swarm.output.world.data
        frames = air.frames[step % air.frames.shape[0]]
        senders = air.senders[: air.senders[-1]]
        begins, ends = frames["begins"][senders], (frames["begins"] + frames["size_bytes"])[senders]
        self._transmitted = {}
        for sender, begin, end in zip(senders.tolist(), begins.tolist(), ends.tolist(), strict=True):
            frame = self._transmitted[sender] = Frame(data[begin:end])
            frame.step = step
        reception, others = self._reception, self._scenario.agents.count - 1
        self.records.append(
            {
                "agents_alive": len(self._present),
                "frames_duplicated": reception.duplicated,
                "frames_in_flight": int(count["frames_sent"]) * others + self._world.air.under_way,
                "frames_dropped": self._no_frames | reception.dropped,
            }
        )
        self.agent_steps += self._taking_part


class Uplinked:
    """The way from the swarm to the operator through the uplink's models, and the operator's count."""

    def __init__(self, scenario: Scenario, uplink: Uplink) -> None:
        self._scenario, self._uplink = scenario, uplink
        self._no_reports = dict.fromkeys(UPLINK_REASONS, 0)
        self.meter = WorkloadMeter(scenario.operator, scenario.run.step_s)
        self.workloads: list[Workload] = []
        self.records: list[dict[str, Any]] = []
        """What the uplink changes in the world's record of each step."""

    def carry(
        self, swarm: Swarm, step: int, positions_m: Floats, there: Sequence[bool], reported: memoryview
    ) -> Workload:
        """Take a step's reports; return the workload by those that arrive."""
        uplink, time_s = self._uplink, step * self._scenario.run.step_s
        sent = {agent: data for agent, _, data in messages_of(reported)}
        arrived = uplink.carry(step, time_s, positions_m, there, self._roots(swarm), sent)
        for data in arrived:
            self.meter.count(read_own_report(data), data)
        workload = self.meter.close_step(Clock(step, time_s, step == self._scenario.run.steps - 1), 0)
        self.workloads.append(workload)
        self.records.append(
            {
                "reports_arrived": len(arrived),
                "reports_in_flight": uplink.under_way,
                "reports_dropped": self._no_reports | uplink.dropped,
            }
        )
        return workload

    def _roots(self, swarm: Swarm) -> dict[int, int]:
        """Return the root of each agent that is in a tree, for the relay."""
        if not self._scenario.uplink.relay:
            return {}
        agents = swarm.agents
        in_trees = np.flatnonzero(agents["has_status"] & (agents["role"] >= ROOT_ROLE))
        return dict(zip(in_trees.tolist(), agents["path"][in_trees, 0].tolist(), strict=True))


def _stop(agents: np.ndarray, agent: int) -> None:
    agents["vx_mps"][agent] = agents["vy_mps"][agent] = 0.0
