"""Controllers: plug-ins that decide for an agent. A controller is a pure object from percepts to decisions.

`control.mode` names a controller by a short name, by an entry point of the group `deltaswarm.controllers`, or as
`module:Class`. Its options are its own frozen dataclass `Settings` and stand in `[control]`. It has no clock, no
network and no randomness except the given generator, so it behaves the same in its own process, in one process with
others, and on a board.
"""

from dataclasses import dataclass
from random import Random
from typing import Any, ClassVar, NamedTuple, Protocol

from deltaswarm_wire.codec import MAX_AGENT_ID, MAX_ID
from deltaswarm_wire.commands import Command
from deltaswarm_wire.messages import (
    FREE,
    MAX_DELTA,
    MAX_POSES,
    MAX_SENSED,
    MAX_SPEED_MPS,
    NOBODY,
    Act,
    Event,
    Pose,
    TreeStatus,
    role_name,
)
from deltaswarm_wire.operator_messages import ReportedMember
from deltaswarm_wire.plugin_errors import PluginError, is_interrupt
from deltaswarm_wire.plugins import controller_settings, find_controller
from deltaswarm_wire.settings import AgentSettings

Velocity = tuple[float, float]
"""Along x and y [m/s; world frame]."""

STAND: Velocity = (0.0, 0.0)


@dataclass(frozen=True)
class ControllerContext:
    """The arguments of a new controller.

    Attributes:
        agent: the agent's id.
        mode: the name of the controller in `control.mode`.
        settings: its own options, an instance of its `Settings`.
        shared: the agent's task and body: arena, step, speed, ranges.
        rng: the agent's own generator; the only source of randomness.
    """

    agent: int
    mode: str
    settings: Any
    shared: AgentSettings
    rng: Random


class Percept(NamedTuple):
    """What an agent senses and hears in one step.

    Attributes:
        step: the number of the step; steps may be missing between two percepts.
        time_s: its simulated time [s].
        pose: the agent's position [m; world frame].
        poses: where it was in the steps between its last percept and this one, oldest first; without `pose`, and empty
            if it was asked in the step before.
        events: the events within its sensing range.
        heard: (sender, payload) of received radio frames in sender order, the newest of each sender.
        commands: operator commands that are new to the agent, meant for it, and declared by its controller. `life_s` is
            what remains of a command's life; the same command comes again if it turns out to live longer.
        bumped: whether its body touched another one, an obstacle or the arena's edge in the last step; never a point.
        blocked: whether something kept its body from moving as it had decided; never a point.
    """

    step: int
    time_s: float
    pose: Pose
    poses: tuple[Pose, ...]
    events: tuple[Event, ...]
    heard: list[tuple[int, bytes]]
    commands: tuple[Command, ...] = ()
    bumped: bool = False
    blocked: bool = False


class OperatorReport(NamedTuple):
    """One message for the operator: reported events, and the number of agents represented besides the sender.

    `members` may name these agents, with parents and places. At most 64 events and 350 members are sent
    (`operator_messages.MAX_REPORTED`, `MAX_MEMBERS`).
    """

    events: tuple[Event, ...]
    followers: int = 0
    members: tuple[ReportedMember, ...] = ()


class Decision(NamedTuple):
    """What an agent does until its next percept.

    Attributes:
        velocity: [m/s; world frame]; above the body's speed limit the direction is kept.
        observed: ids of the events that it works on; events out of its sensing range do not count.
        payload: its broadcast in this step, or None.
        report: its message to the operator in this step, or None.
        role: a word for figures and recordings, such as "free" or "attending".
        level, parent, root: its place in a tree, if it is in one (see `TreeStatus`).
        until: the step of the next percept, later than this one; None: the next step. The percept comes earlier if the
            agent senses an event, receives a frame or a command, has a fault, or is bumped or blocked.
        done, refused, superseded: numbers of the operator commands that it has carried out, cannot carry out, or no
            longer carries out because of a later one.
        delta: the number of events sensed at once that would make it a root now, if it has one (see `TreeStatus`).
    """

    velocity: Velocity = STAND
    observed: tuple[int, ...] = ()
    payload: bytes | None = None
    report: OperatorReport | None = None
    role: str = FREE
    level: int = 0
    parent: int = NOBODY
    root: int = NOBODY
    until: int | None = None
    done: tuple[int, ...] = ()
    refused: tuple[int, ...] = ()
    superseded: tuple[int, ...] = ()
    delta: int = 0


class Controller(Protocol):
    """One agent's decisions. Made once per agent and start; `step` is called in order of the steps.

    `Metrics` of the class, a tuple of `ControllerMetric` (`deltaswarm_wire.controller_metrics`), declare numbers of
    its own, which the mapping `metrics` of the object holds after each step. A mapping `counts` of names to numbers, if
    there is one, goes into the agent's log at the end. `Commands` of the class, a tuple of `CommandForm`, are the
    operator commands that it accepts; without it there are none.
    """

    Settings: ClassVar[type[Any]]
    """A frozen dataclass whose fields are made by `deltaswarm_wire.checked.key`.

    It may have a method `problems_with(shared: AgentSettings) -> list[Problem]`.
    """

    def __init__(self, context: ControllerContext) -> None: ...

    def step(self, percept: Percept) -> Decision:
        """Decide."""


class ControllerError(PluginError):
    """A controller raised or returned an invalid decision; the agent has failed. The text is one line."""


def agent_rng(seed: int, agent: int, restart: int = 0) -> Random:
    """Make the agent's generator; equal for equal seed and restart number on any machine."""
    return Random(f"deltaswarm/{seed}/agent/{agent}" + (f"/restart/{restart}" if restart else ""))


def make_controller(agent: int, settings: AgentSettings, restart: int = 0) -> Controller:
    """Make the controller that an agent's settings name.

    Raises:
        SettingsError: there is no such controller, or its options have mistakes.
        ControllerError: its constructor raised.
    """
    control = settings.control
    cls = find_controller(control.mode)
    own_settings = controller_settings(control.mode, control.options, settings)
    context = ControllerContext(agent, control.mode, own_settings, settings, agent_rng(settings.seed, agent, restart))
    try:
        controller: Controller = cls(context)
    except BaseException as error:  # SystemExit too: it would end a run in one process
        if is_interrupt(error):
            raise
        raise ControllerError(f"controller {control.mode} cannot be made", error, cls) from error
    return controller


def is_ours(controller: Controller) -> bool:
    """Whether a controller is one of this package, whose decisions are valid by construction and need no check."""
    return type(controller).__module__.startswith("deltaswarm_agent.controllers.")


def checked_act(decision: Any, step: int) -> Act:
    """Convert a decision to an act with plain values; a controller may be third-party code.

    Raises:
        TypeError, ValueError: the decision is invalid; the text says what must hold.
    """
    if type(decision) is not Decision:
        raise TypeError(f"step must return a Decision (got {type(decision).__name__})")
    velocity, observed, payload, report, role, level, parent, root, until = decision[:9]
    try:
        vx_mps, vy_mps = velocity
        is_allowed = abs(vx_mps) <= MAX_SPEED_MPS and abs(vy_mps) <= MAX_SPEED_MPS
    except (TypeError, ValueError):
        raise TypeError(f"velocity must be two numbers (got {velocity!r:.80})") from None
    if not is_allowed:
        raise ValueError(f"velocity must be finite, at most {MAX_SPEED_MPS:g} m/s (got {vx_mps}, {vy_mps})")
    if payload is not None and type(payload) is not bytes:
        raise TypeError(f"payload must be bytes or None (got {type(payload).__name__})")
    if report is not None and type(report) is not OperatorReport:
        raise TypeError(f"report must be an OperatorReport or None (got {type(report).__name__})")
    if type(observed) is not tuple or observed:
        _check_observed(observed)
    delta = decision.delta
    tree_status = TreeStatus(role_name(role, "role"), level, parent, root, delta)
    if not (
        type(level) is type(parent) is type(root) is type(delta) is int
        and (0 <= level <= MAX_AGENT_ID and NOBODY <= parent <= MAX_AGENT_ID and NOBODY <= root <= MAX_AGENT_ID)
        and 0 <= delta <= MAX_DELTA
    ):
        given = f"{level!r}, {parent!r}, {root!r}, {delta!r}"
        raise ValueError(f"level, parent, root and delta must be whole numbers (got {given})")
    until = step + 1 if until is None else _until(until, step)
    return Act(step, float(vx_mps), float(vy_mps), tuple(observed), tree_status, until)


def _until(until: Any, step: int) -> int:
    try:
        is_later = bool(until >= step + 1)
    except (TypeError, ValueError):
        raise TypeError(f"until must be a step or None (got {type(until).__name__})") from None
    if not is_later:
        raise ValueError(f"until must be later than step {step} (got {until})")
    return int(min(until, step + MAX_POSES))


def _check_observed(observed: Any) -> None:
    if not isinstance(observed, tuple | list | set | frozenset):
        raise TypeError(f"observed must be a tuple of ids of events (got {type(observed).__name__})")
    if not all(type(event) is int and 0 <= event <= MAX_ID for event in observed):
        raise ValueError(f"observed must be ids of events (got {observed!r:.80})")
    if len(observed) > MAX_SENSED:
        raise ValueError(f"observed must name at most {MAX_SENSED} events (got {len(observed)})")
