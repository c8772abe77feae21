"""Controllers: what an agent decides. Each is a plug-in: a pure object that takes a percept and gives a decision.

A controller is named in `control.mode`, by a short name, by an entry point of the group `deltaswarm.controllers`, or
as `module:Class`. Its options are a frozen dataclass of its own, `Settings`, and stand in `[control]`. It has no
clock, no network and no randomness but the generator that it is handed, so that it runs the same as a process, in
one process with others, and on a board.
"""

from dataclasses import dataclass
from random import Random
from typing import Any, ClassVar, NamedTuple, Protocol

from deltaswarm_wire.codec import MAX_AGENT_ID, MAX_ID
from deltaswarm_wire.commands import Command
from deltaswarm_wire.messages import (
    FREE,
    MAX_POSES,
    MAX_SENSED,
    MAX_SPEED_MPS,
    NOBODY,
    Act,
    Event,
    Pose,
    Standing,
    role_name,
)
from deltaswarm_wire.operator_messages import ReportedMember
from deltaswarm_wire.plugins import controller_settings, described, find_controller
from deltaswarm_wire.settings import AgentSettings

Velocity = tuple[float, float]
"""Along x and y [m/s; world frame]."""

STAND: Velocity = (0.0, 0.0)


@dataclass(frozen=True)
class ControllerContext:
    """What a controller is told when it is made.

    Attributes:
        agent: the agent's id.
        mode: the name by which the controller was asked for.
        settings: its own options, an instance of its `Settings`.
        shared: the agent's task and body: arena, step, speed, ranges.
        rng: the agent's own generator; the only source of chance.
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
        pose: where the agent is [m; world frame].
        poses: where it was in the steps since its last percept, oldest first.
        events: the events within its sensing range.
        heard: (sender, payload) of the radio frames that reached it, by sender: of each the newest.
        commands: the operator's commands that are new to it and meant for it, of the forms that its controller
            declares.
    """

    step: int
    time_s: float
    pose: Pose
    poses: tuple[Pose, ...]
    events: tuple[Event, ...]
    heard: list[tuple[int, bytes]]
    commands: tuple[Command, ...] = ()


class OperatorReport(NamedTuple):
    """One message for the operator: events that the agent tells of, and how many agents it speaks for besides itself.

    `members` may name these agents, with parents and places. At most 64 events and 350 members are sent
    (`operator_messages.MAX_REPORTED`, `MAX_MEMBERS`).
    """

    events: tuple[Event, ...]
    followers: int = 0
    members: tuple[ReportedMember, ...] = ()


class Decision(NamedTuple):
    """What an agent does until it is asked again.

    Attributes:
        velocity: [m/s; world frame]; above the body's speed limit the direction is kept.
        observed: ids of the events that it works on; those out of its sensing range do not count.
        payload: what it broadcasts in this step, or None.
        report: what it tells the operator in this step, or None.
        role: a word for figures and recordings, such as "free" or "attending".
        level, parent, root: its place in a tree, if it is in one (see `Standing`).
        until: the step in which it wants to be asked again, later than this one; None is the next. It is asked earlier
            when it senses an event, hears a frame, is commanded, or while a fault is upon it.
        done, refused: numbers of the operator's commands that it has carried out, or cannot.
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


class Controller(Protocol):
    """One agent's decisions. Made once per agent and start; `step` is called in order of the steps.

    It may have a mapping `counts`, names to numbers, that the agent's log tells at the end. Its class may have
    `Commands`, a tuple of `CommandForm`: the operator's commands that it accepts. Without it, it is given none.
    """

    Settings: ClassVar[type[Any]]
    """A frozen dataclass whose fields are made by `deltaswarm_wire.checked.key`.

    It may have a method `problems_with(shared: AgentSettings) -> list[Problem]`.
    """

    def __init__(self, context: ControllerContext) -> None: ...

    def step(self, percept: Percept) -> Decision:
        """Decide."""


class ControllerError(Exception):
    """A controller raised, or returned what it may not; the agent has failed. The text is one line."""


def agent_rng(seed: int, agent: int, restart: int = 0) -> Random:
    """The agent's own generator; the same for the same seed and number of its restart on any machine."""
    return Random(f"deltaswarm/{seed}/agent/{agent}" + (f"/restart/{restart}" if restart else ""))


def make_controller(agent: int, settings: AgentSettings, restart: int = 0) -> Controller:
    """The controller that an agent's settings ask for.

    Raises:
        SettingsError: there is no such controller, or its options have mistakes.
        ControllerError: it raised while it was made.
    """
    control = settings.control
    found = find_controller(control.mode)
    own = controller_settings(control.mode, control.options, settings)
    context = ControllerContext(agent, control.mode, own, settings, agent_rng(settings.seed, agent, restart))
    try:
        controller: Controller = found(context)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit too: it would end a run in one process
        raise ControllerError(f"controller {control.mode} cannot be made: {described(error)}") from error
    return controller


def checked_act(decision: Any, step: int) -> Act:
    """The act of a decision, as plain values that the wire carries; a controller may be anybody's.

    Raises:
        TypeError, ValueError: it is not what a controller may return; the text says what must hold.
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
    standing = Standing(role_name(role, "role"), level, parent, root)
    if not (
        type(level) is type(parent) is type(root) is int
        and (0 <= level <= MAX_AGENT_ID and NOBODY <= parent <= MAX_AGENT_ID and NOBODY <= root <= MAX_AGENT_ID)
    ):
        raise ValueError(f"level, parent and root must be whole numbers (got {level!r}, {parent!r}, {root!r})")
    until = step + 1 if until is None else _until(until, step)
    return Act(step, float(vx_mps), float(vy_mps), tuple(observed), standing, until)


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
