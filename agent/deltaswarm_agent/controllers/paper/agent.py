"""The state of one agent; each of the paper's rules reads and changes it."""

from dataclasses import replace

from deltaswarm_agent.controller import ControllerContext
from deltaswarm_agent.controllers.paper.bandit import ARMS, Bandit
from deltaswarm_agent.controllers.paper.beliefs import Beliefs
from deltaswarm_agent.controllers.paper.delta import delta_for
from deltaswarm_agent.controllers.paper.experience import Experience
from deltaswarm_agent.controllers.paper.finds import Finds
from deltaswarm_agent.controllers.paper.frames import Member, PaperFrame, RecruitmentOrder
from deltaswarm_agent.controllers.paper.hybrid import strategy_of
from deltaswarm_agent.controllers.paper.membership import Membership, PreviousTree
from deltaswarm_agent.controllers.paper.policy import Structure, structure_of
from deltaswarm_agent.controllers.paper.returning import FoundPlaces
from deltaswarm_agent.controllers.paper.settings import BANDIT, BUSY, FIXED, LEARNED, PaperSettings
from deltaswarm_agent.controllers.paper.states import ATTENDING, TRANSITIONS, WALKING, Cause
from deltaswarm_agent.controllers.paper.timers import steps_of, timers
from deltaswarm_agent.controllers.paper.walk import Walk
from deltaswarm_agent.controllers.paper.whereabouts import Whereabouts
from deltaswarm_agent.recurring import Recurring
from deltaswarm_wire.messages import Event, Pose

GOLDEN_RATIO = (5**0.5 - 1) / 2
"""Its multiples, modulo 1, are the most even sequence of their kind."""


class Agent:
    def __init__(self, context: ControllerContext) -> None:
        settings: PaperSettings = context.settings
        self.id = context.agent
        self.settings = settings
        self.shared = context.shared
        self.rng = context.rng
        self.strategy = strategy_of(context.mode, settings)
        self.timers = timers(context.shared.step_s, context.shared.latency_s)
        self.here = Whereabouts(context.shared, settings.d_min_m, self.timers.trail)
        self.finds: Finds | None = None
        """What it knows about finding events, if a rule needs it."""
        if settings.patience_finds or settings.return_to_finds or self.strategy.rule != FIXED:
            self.finds = Finds(context.shared)
        self.experience: Experience | None = None
        """What its policy is given, if it has one."""
        if self.strategy.rule == LEARNED:
            self.experience = Experience(context.shared.step_s)
        self.bandit: Bandit | None = None
        """What it has learned on the way, under that rule."""
        if self.strategy.rule == BANDIT:
            self.bandit = Bandit(context.shared.step_s)
            self.take(ARMS[0])
        self.price_s = settings.message_price
        self.found: FoundPlaces | None = None
        if self.finds is not None and settings.return_to_finds:
            self.found = FoundPlaces(steps_of(settings.find_memory_s, context.shared.step_s), self.finds, context)
        self.walk = Walk(context.shared, settings.leg_max_s, context.rng, self.found, settings.leg_exponent)
        self.sensed: frozenset[int] = frozenset()
        self.sensed_step = -1
        """The events that it sensed when it last noted them, and that step."""
        self.new: tuple[Event, ...] = ()
        """Those that it did not sense in the step before, if a rule needs them."""
        self.rejected_frames = 0
        """Received invalid frames."""
        self.rows_cut = 0
        """Descendants beyond a frame's table."""
        self.beliefs = Beliefs(context.shared.sensing_range_m, self.timers)
        self.reporting = Recurring(settings.report_every_s)
        self.now = 0
        self.state = WALKING
        self.target: Event | None = None
        """The event that a free agent goes to or observes."""
        self.membership: Membership | None = None
        self.gamma = 0.0
        """The dissolution parameter."""
        self.idle_s = 0.0
        """Time in its tree without an event (`patience.py`)."""
        self.contested = 0
        """Steps in which this root has stayed beside an equal one."""
        self.order: RecruitmentOrder | None = None
        """The order that this agent sends, or relays, in this step."""
        self.followed_order: int | None = None
        """The number of the last order that this agent carried out in its tree."""
        self.recruit_goal: Pose = (0.0, 0.0)
        """Target of a recruitment order."""
        self.recruits_in_transit: dict[int, tuple[Pose, int]] = {}
        """A root's travelling recruited agents: their targets, and until when these are blocked."""
        self.since = 0
        """Since when an orphan, or a recruited agent at its target, has looked for a parent."""
        self.leave_frames_left = 0
        """Remaining frames that announce its leaving."""
        self.previous_tree: PreviousTree | None = None
        self.founds_from = 0
        """The step from which it may found a tree; the operator's `recall` postpones it."""
        self.holds_until = 0
        """The step until which the operator's `hold` makes it stand still."""
        self.goto: Pose | None = None
        """Where the operator has sent it."""
        self.goto_until = 0
        """The step with which this walk ends."""
        self.strategy_command = self.hold_command = self.errand_command = 0
        """The numbers of the newest orders that changed the strategy, whether it stands still, and where it goes."""
        self.done: list[int] = []
        self.refused: list[int] = []
        self.superseded: list[int] = []
        """Numbers of the operator's commands that ended in this step: carried out, not possible, replaced."""

    @property
    def delta(self) -> int | None:
        """Events sensed at once that make it a root (delta, or rho); None: never."""
        if self.strategy.rule == BUSY and self.finds is not None:
            return delta_for(self.finds.busy)
        return self.strategy.founds_at

    @property
    def rank(self) -> float:
        """Its place from 0 to 1 among all agents, by its number alone: any share of a swarm is spread evenly."""
        return self.id * GOLDEN_RATIO % 1

    def choose_structure(self) -> None:
        """Follow the policy, if the agent has one and no order of the operator's has replaced it."""
        strategy = self.strategy
        if strategy.rule != LEARNED or self.experience is None or self.finds is None:
            return
        inputs = self.experience.inputs(self.finds, self.state is ATTENDING, self.price_s, self.now)
        self.take(structure_of(self.settings.policy, inputs, self.rank))

    def take(self, chosen: Structure) -> None:
        if chosen != (self.strategy.founds_at, self.strategy.attends):
            self.strategy = replace(self.strategy, founds_at=chosen.founds_at, attends=chosen.attends)

    def note(self, sensed: tuple[Event, ...]) -> None:
        """Note the events that are new in this step."""
        before = self.sensed if self.sensed_step == self.now - 1 else ()
        self.new = tuple([event for event in sensed if event.event not in before])
        self.sensed, self.sensed_step = frozenset([event.event for event in sensed]), self.now

    def steps(self, seconds: float | str) -> int:
        return round(float(seconds) / self.shared.step_s)

    def end_errand(self, outcome: list[int]) -> None:
        """Go where the operator sent it no longer, if it does, and note the outcome of that command."""
        if self.goto is not None:
            self.goto = None
            outcome.append(self.errand_command)

    def change(self, cause: Cause) -> None:
        """Change the state along the table; the only place where it changes."""
        self.state = TRANSITIONS[self.state, cause]
        if self.experience is not None:
            self.experience.changed = self.now
        if self.state is WALKING:
            self.target = None
            if self.found is not None:
                self.found.give_up_goal()
            if self.bandit is not None and self.finds is not None and self.strategy.rule == BANDIT:
                self.take(self.bandit.choose(self.finds.busy, self.price_s, self.rng, self.now))
            self.walk.turn(self.now, self.here.x_m, self.here.y_m)

    def enter_tree(self, parent: Member | None, cause: Cause) -> Membership:
        """Become a member below `parent`, or a root."""
        self.change(cause)
        self.membership = Membership(self.id, parent, self.now, self.timers)
        if self.bandit is not None and parent is not None and parent.averages and parent.averages.tried:
            self.bandit.follow(parent.averages.tried.arm, self.now)
        self.stay()
        self.contested = 0
        self.target = self.order = self.followed_order = None
        self.recruits_in_transit.clear()
        self.leave_frames_left = 0
        return self.membership

    def stay(self) -> None:
        """Restart the wait for events."""
        self.gamma = self.settings.gamma_max
        self.idle_s = 0.0

    def leave_tree(self, cause: Cause) -> None:
        """Become free; the whole subtree follows, since children hear it and leave, too."""
        assert self.membership is not None
        self.previous_tree = PreviousTree(self.membership, self.now, self.timers)
        self.membership = None
        self.leave_frames_left = self.timers.leaving
        self.change(cause)

    def sender_distance(self, frame: PaperFrame) -> tuple[float, int]:
        """Sort key for the nearest sender, ties by lowest id."""
        return self.here.sender_m2(frame), frame.sender

    def event_distance(self, event: Event) -> tuple[float, int]:
        """Sort key for the nearest event."""
        return self.here.distance_m2(event.x_m, event.y_m), event.event
