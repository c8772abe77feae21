"""A run in arrays whose agents are moved from outside: its set-up, its steps, and which scenarios allow it."""

from dataclasses import replace

import numpy as np

from deltaswarm_dense.acted import AGENT, FRAME, SETTINGS, Acted, Broadcasts, advance_acted
from deltaswarm_dense.coverage import not_covered
from deltaswarm_dense.layout import TROUBLE
from deltaswarm_dense.modelled import is_modelled
from deltaswarm_dense.setting_up import draw_losses, events_in_order, room_for_draws, world_of
from deltaswarm_dense.step import BYTES_PER_AGENT
from deltaswarm_orchestrator.run.engine import UncoveredError
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.digest import SIZE_BYTES, combine, next_link
from deltaswarm_wire.messages import MAX_SENSED
from deltaswarm_wire.settings import ControlSettings
from deltaswarm_world.core.air.channel.loss import Loss
from deltaswarm_world.core.arrays import generator
from deltaswarm_world.core.environment import Environment


def set_up(scenario: Scenario, event_slots: int, frame_slots: int, message_size: int) -> Acted:
    """Make the arrays of a run."""
    n, environment = scenario.agents.count, Environment(scenario)
    events = events_in_order(scenario, environment)
    e, radio, bits = len(events), scenario.radio, np.zeros(1)
    settings = np.zeros(1, SETTINGS)
    values = {
        "step_s": scenario.run.step_s,
        "width_m": scenario.arena.width_m,
        "height_m": scenario.arena.height_m,
        "speed_mps": scenario.agents.speed_mps,
        "sensing_range_m": scenario.agents.sensing_range_m,
        "sensing_m2": scenario.agents.sensing_range_m**2,
        "range_m2": radio.range_m**2,
        "work_agent_s": scenario.events.work_agent_s,
        "loss": radio.loss,
        "horizon_s": scenario.metrics.horizon_s,
        "half": 0.5,
        "event_slots": event_slots,
        "frame_slots": frame_slots,
    }
    for name, value in values.items():
        settings[name] = value
    agents = np.zeros(n, AGENT)
    agents["id"], agents["sees"] = np.arange(n), True
    agents["x_m"], agents["y_m"] = environment.positions_m.T
    draws = room_for_draws(radio.loss, n)

    def numbers(*shape: int) -> np.ndarray:
        return np.zeros(shape, np.int64)

    return Acted(
        settings=settings,
        agents=agents,
        world=world_of(events),
        air=Broadcasts(
            frames=np.zeros((2, n), FRAME),
            messages=numbers(2, n, message_size),
            senders=numbers(n + 1),
            arrived=numbers(n, 2),
            draws=draws,
            drawn=np.array([len(draws)]),
        ),
        near=numbers(n, min(e, MAX_SENSED)),
        untold=np.zeros(e, np.bool_),
        followed=numbers(2),
        buffers=(np.zeros(n * BYTES_PER_AGENT, np.uint8), np.zeros(n * BYTES_PER_AGENT, np.uint8)),
        ends=numbers(2),
        bits=(bits, bits.view(np.uint64)),
        trouble=numbers(1),
    )


def why_not(scenario: Scenario) -> str:
    """Return why agents cannot be moved in arrays in a scenario; empty if they can."""
    found = not_covered(replace(scenario, control=ControlSettings()))
    for name, is_on in (
        ("fault, or a radio model other than range and loss", is_modelled(scenario)),
        ("uplink", scenario.uplink.is_on),
        ("an operator at the console", scenario.has_console),
    ):
        found += [name] if is_on else []
    return ", ".join(found)


class ActedRun:
    """One run whose agents are moved from outside.

    Args:
        scenario: one for which `why_not` is empty.
        sizes: event slots, frame slots, and numbers of a broadcast.
    """

    def __init__(self, scenario: Scenario, sizes: tuple[int, int, int]) -> None:
        self._acted = set_up(scenario, *sizes)
        self._lossy = generator(scenario.seed, Loss.stream)
        self._step = -1
        self._chains = [bytes(SIZE_BYTES), bytes(SIZE_BYTES)]

    @property
    def digest(self) -> str:
        """The digest of the steps so far, as `Outcome.digest` has it."""
        world, operator = (chain.hex() for chain in self._chains)
        return combine(world, operator)

    def advance(self, actions: np.ndarray, observations: np.ndarray, numbers: np.ndarray) -> None:
        """Do a step; the first call begins the run, whatever its actions.

        Args:
            actions: (n, k) float32 from -1 to 1.
            observations: (n, o) float32, which get what agents sense and hear then.
            numbers: (9,) get what happened, in the order of `REWARDS`.

        Raises:
            UncoveredError: an agent senses or hears more than its frame has room for.
        """
        draw_losses(self._acted.air, self._lossy)
        advance_acted(self._acted, self._step, actions, observations, numbers)
        if trouble := int(self._acted.trouble[0]):
            raise UncoveredError(TROUBLE[trouble])
        for which, (buffer, end) in enumerate(zip(self._acted.buffers, self._acted.ends.tolist(), strict=True)):
            if end:
                self._chains[which] = next_link(self._chains[which], [buffer[:end].data])
        self._step += 1
