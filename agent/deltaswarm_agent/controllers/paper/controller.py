"""The paper's controllers: decentralised, hierarchical and hybrid."""

from typing import ClassVar

from deltaswarm_agent.controller import ControllerContext, Decision, Percept
from deltaswarm_agent.controllers.paper import commands
from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.one_step import decide
from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_wire.commands import CommandForm

REPORTING_ROLES = ("attending", "leaving", "root")
"""The roles in which agents report to the operator."""


class PaperController:
    """One agent of a decentralised, hierarchical or hybrid swarm. `step` is its only mutating method.

    It is the plug-in around `one_step.py`, and may be subclassed.
    """

    Settings: ClassVar[type[PaperSettings]] = PaperSettings
    Commands: ClassVar[tuple[CommandForm, ...]] = commands.FORMS

    def __init__(self, context: ControllerContext) -> None:
        self.agent = Agent(context)

    @property
    def counts(self) -> dict[str, int]:
        """Received invalid frames; descendants beyond a frame's table."""
        return {"rejected_frames": self.agent.rejected_frames, "rows_cut": self.agent.rows_cut}

    @property
    def state(self) -> State:
        return self.agent.state

    @property
    def membership(self) -> Membership | None:
        """Its place in a tree; None if it is free."""
        return self.agent.membership

    def step(self, percept: Percept) -> Decision:
        return decide(self.agent, percept)
