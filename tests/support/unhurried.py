"""Controllers for runs that are watched or struck: `Unhurried` and `Late`."""

import os
import time
from dataclasses import replace
from pathlib import Path

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


class Late(Unhurried):
    """Is not ready before there is the file that the environment names in `MAY_BEGIN`."""

    def __init__(self, context: ControllerContext) -> None:
        while not Path(os.environ["MAY_BEGIN"]).exists():
            time.sleep(PAUSE_S)
        super().__init__(context)
