"""The paper's decentralised swarm as a Mesa model, to compare speeds: objects that see each other, and no messages.

    pip install mesa && python mesa_model.py [STEPS] [SEED]

It prints the CPU time of the run [s], its steps per second, and the numbers of events and of completed ones.
"""

import math
import sys
import time

import mesa
from mesa.space import ContinuousSpace

AGENTS, SIDE_M, SPEED_MPS = 25, 100.0, 1.0
SENSING_M, RADIO_M, LEG_MAX_S = 5.0, 9.0, 100.0
RATE_HZ, WORK_AGENT_S, SPREAD_M = 0.05, 200.0, math.sqrt(50.0)


class Event:
    """One event, and how much work it still needs [agent seconds]."""

    def __init__(self, place_m: tuple[float, float]) -> None:
        self.place_m = place_m
        self.left_s = WORK_AGENT_S


class Walker(mesa.Agent):
    """Walks at random, goes to an event that it senses or of which a neighbour knows, and works on it."""

    def __init__(self, model: "Swarm") -> None:
        super().__init__(model)
        self.target: Event | None = None
        self.attends = False
        self.near: set[int] = set()
        self.turn()

    def turn(self) -> None:
        """Begin a new leg of the walk."""
        heading = self.random.uniform(0.0, math.tau)
        self.vx, self.vy = SPEED_MPS * math.cos(heading), SPEED_MPS * math.sin(heading)
        self.leg_s = self.random.uniform(0.0, LEG_MAX_S)

    def step(self) -> None:
        """Sense, decide and move."""
        x, y = self.pos
        sensed = [event for event in self.model.active if math.dist(event.place_m, self.pos) <= SENSING_M]
        neighbours = self.model.space.get_neighbors(self.pos, RADIO_M, include_center=False)
        met = [other for other in neighbours if other.attends and other.unique_id not in self.near]
        self.near = {other.unique_id for other in neighbours}
        if self.target is not None and self.target.left_s <= 0.0:
            self.target, self.attends = None, False
        if self.target is None:
            if sensed:
                self.target = min(sensed, key=lambda event: math.dist(event.place_m, self.pos))
            elif met:
                self.target = met[0].target
        if self.target is not None:
            gap_m = math.dist(self.target.place_m, self.pos)
            if gap_m <= SPEED_MPS:
                self.attends = True
                self.target.left_s -= 1.0
                self.model.space.move_agent(self, self.target.place_m)
                return
            ex, ey = self.target.place_m
            self.model.space.move_agent(self, (x + (ex - x) / gap_m * SPEED_MPS, y + (ey - y) / gap_m * SPEED_MPS))
            return
        self.leg_s -= 1.0
        if self.leg_s <= 0.0:
            self.turn()
        if not 0.0 <= x + self.vx < SIDE_M:
            self.vx = -self.vx
        if not 0.0 <= y + self.vy < SIDE_M:
            self.vy = -self.vy
        self.model.space.move_agent(self, (x + self.vx, y + self.vy))


class Swarm(mesa.Model):
    """The arena, its events and 25 walkers."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed=seed)
        self.space = ContinuousSpace(SIDE_M, SIDE_M, torus=False)
        self.active: list[Event] = []
        self.events = self.completed = 0
        for walker in Walker.create_agents(self, AGENTS):
            self.space.place_agent(walker, (self.random.uniform(0, SIDE_M), self.random.uniform(0, SIDE_M)))

    def step(self) -> None:
        """Let events arrive, all walkers act in random order, and completed events go."""
        if self.random.random() < RATE_HZ:
            place = [min(max(self.random.gauss(SIDE_M / 2, SPREAD_M), 0.0), SIDE_M - 1e-9) for _ in range(2)]
            self.active.append(Event((place[0], place[1])))
            self.events += 1
        self.agents.shuffle_do("step")
        left = [event for event in self.active if event.left_s > 0.0]
        self.completed += len(self.active) - len(left)
        self.active = left


if __name__ == "__main__":
    steps, seed = (int(text) for text in [*sys.argv[1:], *("9000", "1")[len(sys.argv) - 1 :]])
    swarm = Swarm(seed)
    began = time.process_time()
    for _ in range(steps):
        swarm.step()
    cpu_s = time.process_time() - began
    print(f"{cpu_s:.2f} s, {steps / cpu_s:.0f} steps/s, {swarm.events} events, {swarm.completed} completed")
