"""A controller for runs that are watched or struck: `tests.unhurried:Unhurried`."""

import time
from dataclasses import replace

from deltaswarm_agent.controller import ControllerContext, Decision, Percept
from deltaswarm_agent.controllers.paper.controller import PaperController

PAUSE_S = 0.03


class Unhurried(PaperController):
    """The paper's in hybrid mode, with a pause before each decision: a run of few steps lasts long enough."""

    def __init__(self, context: ControllerContext) -> None:
        super().__init__(replace(context, mode="hybrid"))

    def step(self, percept: Percept) -> Decision:
        """Wait, and decide."""
        time.sleep(PAUSE_S)
        return super().step(percept)
