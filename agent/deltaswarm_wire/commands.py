"""Commands: what the operator tells the swarm, and the messages in which commands travel.

The operator sends its commands with its `turn` of a step. They leave its base as radio frames of the sender `BASE_ID`,
and agents relay them as items of their own radio frames, hop by hop, until a command's life is over.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Annotated, Any, NamedTuple

from deltaswarm_wire.checked import key
from deltaswarm_wire.codec import (
    MAX_ABS_M,
    MAX_AGENT_ID,
    MAX_ID,
    MAX_STEP,
    PROTOCOL_VERSION,
    WireError,
    array,
    arrays,
    integer,
    number,
    octets,
    pack,
    shown,
    text,
    unpack,
    version,
)
from deltaswarm_wire.plugin_errors import PluginError, defined_at
from deltaswarm_wire.records import Limits, Record

BASE_ID = MAX_AGENT_ID
"""The sender of the base's radio frames; no agent has this id."""

MAX_COMMAND_BYTES = 300
MAX_SIGNATURE_BYTES = 64
MAX_ARGUMENTS = 8
MAX_TEXT = 64
"""Characters of a name or of a text among the arguments."""
MAX_IN_TURN = 16
MAX_LIFE_S = 86_400.0

AHEAD_S = 128.0
"""Maximum lead of signed commands' numbers over the operator's clock: several may be given in one second."""

ALL, CIRCLE, TREE, AGENT, PLACE = "all", "circle", "tree", "agent", "place"
TARGET_NUMBERS = {ALL: 0, CIRCLE: 3, TREE: 1, AGENT: 1, PLACE: 2}
"""Kinds of targets, and how many numbers each has: x, y and radius [m]; a root; an agent; x and y [m]."""

KINDS = ("integer", "number", "text", "choice")
Value = int | float | str


@dataclass(frozen=True)
class ArgumentForm:
    """One argument of a command that a controller accepts."""

    name: str = key("", "its name")
    kind: str = key("number", "what it is", choices=KINDS)
    low: float = key(-1e9, "least value")
    high: float = key(1e9, "greatest value")
    choices: tuple[str, ...] = key((), "choice: the values it may have")
    default: float = key(0.0, "what a form begins with")
    unit: str = key("", "its unit")
    help: str = key("", "what it means")

    def problem(self, value: Any) -> str | None:
        """What is wrong with a value, if anything."""
        if self.kind == "choice":
            return None if value in self.choices else f"{self.name} must be one of {', '.join(self.choices)}"
        if self.kind == "text":
            fits = isinstance(value, str) and len(value) <= MAX_TEXT and value.isprintable()
            return None if fits else f"{self.name} must be a text of at most {MAX_TEXT} printable characters"
        kinds = (int,) if self.kind == "integer" else (int, float)
        if type(value) in kinds and self.low <= value <= self.high:
            return None
        return f"{self.name} must be {_a(self.kind)} from {self.low:.15g} to {self.high:.15g} (got {value!r:.40})"


@dataclass(frozen=True)
class CommandForm:
    """A command that a controller accepts; the operator's station shows a form for it."""

    name: str = key("", "its name")
    targets: tuple[str, ...] = key((ALL,), "kinds of recipients", choices=tuple(TARGET_NUMBERS))
    arguments: tuple[ArgumentForm, ...] = key((), "its arguments")
    help: str = key("", "what it does")
    refused_in: tuple[str, ...] = key(
        (), "control modes in which every agent refuses it; the station does not offer it"
    )

    def problem(self, target: "Target", arguments: Mapping[str, Any]) -> str | None:
        """What is wrong with a command of this form, if anything."""
        if target.kind not in self.targets:
            return f"{self.name} must be for {' or '.join(self.targets)} (got {target.kind})"
        names = {argument.name for argument in self.arguments}
        if not isinstance(arguments, Mapping) or names != arguments.keys():
            return f"{self.name} must have the arguments {', '.join(sorted(names)) or 'none'}"
        problems = (argument.problem(arguments[argument.name]) for argument in self.arguments)
        return next((problem for problem in problems if problem), None)


def _a(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


class Target(NamedTuple):
    """The recipients of a command."""

    kind: str = ALL
    numbers: tuple[float, ...] = ()

    def covers(self, agent: int, place_m: tuple[float, float], root: int) -> bool:
        """Whether an agent at a position, in the tree of a root, is a recipient; of a `place`, each agent judges."""
        if self.kind == CIRCLE:
            x_m, y_m, radius_m = self.numbers
            return hypot(place_m[0] - x_m, place_m[1] - y_m) <= radius_m
        return self.kind in (ALL, PLACE) or self.numbers[0] == (root if self.kind == TREE else agent)

    def __str__(self) -> str:
        shown = [f"{value:g}" for value in self.numbers]
        if self.kind == CIRCLE:
            return f"{shown[2]} m around ({shown[0]}, {shown[1]})"
        return f"({shown[0]}, {shown[1]})" if self.kind == PLACE else " ".join([self.kind, *shown])


class Command(NamedTuple):
    """One command. `number` counts the run's commands; after `life_s` no agent relays it or starts carrying it out."""

    number: int
    name: str
    target: Target
    arguments: dict[str, Value]
    life_s: float


def encode_command(command: Command) -> bytes:
    """`[version, number, name, [kind, number...], {argument: value}, life_s]`.

    Raises:
        WireError: it could not be decoded.
    """
    target = (command.target.kind, *map(float, command.target.numbers))
    arguments = dict(sorted(_arguments(command.arguments).items()))
    items = (PROTOCOL_VERSION, command.number, command.name, target, arguments, float(command.life_s))
    data = pack(items, MAX_COMMAND_BYTES)
    decode_command(data)
    return data


def decode_command(data: bytes) -> Command:
    """Check and decode. Raises WireError."""
    known, count, name, target, arguments, life_s = array(unpack(data, MAX_COMMAND_BYTES), 6, "command")
    version(known)
    return Command(
        integer(count, 0, MAX_ID, "command.number"),
        _printable(name, "command.name"),
        make_target(target),
        _arguments(arguments),
        number(life_s, 0.0, MAX_LIFE_S, "command.life_s"),
    )


def make_target(raw: Any) -> Target:
    """A target of `[kind, number...]`. Raises WireError."""
    rows = arrays(raw, 4, "command.target")
    kind = text(rows[0] if rows else None, "command.target", allowed=tuple(TARGET_NUMBERS))
    numbers = tuple([number(value, -MAX_ABS_M, MAX_ABS_M, "command.target") for value in rows[1:]])
    if len(numbers) != TARGET_NUMBERS[kind]:
        raise WireError("command.target", f"have {TARGET_NUMBERS[kind]} numbers for {kind}", len(numbers))
    if kind in (TREE, AGENT) and not (numbers[0].is_integer() and 0 <= numbers[0] < BASE_ID):
        raise WireError("command.target", "be the number of an agent", numbers[0])
    if kind == CIRCLE and numbers[2] < 0:
        raise WireError("command.target", "have a radius of at least 0 m", numbers[2])
    return Target(kind, numbers)


def _arguments(raw: Any) -> dict[str, Value]:
    if type(raw) is not dict or len(raw) > MAX_ARGUMENTS:
        raise WireError("command.arguments", f"be a map of at most {MAX_ARGUMENTS} arguments", shown(raw))
    return {_printable(name, "command.arguments"): _argument(value) for name, value in raw.items()}


def _argument(value: Any) -> Value:
    if type(value) is str:
        return _printable(value, "command.arguments")
    if type(value) is int:
        return integer(value, -MAX_ID, MAX_ID, "command.arguments")
    return number(value, -1e12, 1e12, "command.arguments")


def _printable(value: Any, field: str) -> str:
    name = text(value, field, MAX_TEXT)
    if not name.isprintable():
        raise WireError(field, "be printable", ascii(name))
    return name


class Signed(NamedTuple):
    """An encoded command and its signature, which is empty in an emulated run: only the base can send as the base."""

    body: bytes
    signature: bytes = b""


class Relayed(NamedTuple):
    """A command on the air, with the remaining steps of its life."""

    left_steps: int
    signed: Signed


def encode_relayed(item: Relayed) -> bytes:
    """`[left_steps, body, signature]`."""
    return pack((item.left_steps, *item.signed))


def decode_relayed(data: bytes) -> Relayed:
    """Check and decode all but the command itself. Raises WireError."""
    left_steps, *signed = array(unpack(data), 3, "relayed")
    return Relayed(integer(left_steps, 0, MAX_STEP, "relayed.left_steps"), _signed(signed))


def _signed(raw: Any) -> Signed:
    body, signature = array(raw, 2, "command")
    return Signed(octets(body, MAX_COMMAND_BYTES, "command"), octets(signature, MAX_SIGNATURE_BYTES, "command"))


def _commands(raw: Any, field: str) -> tuple[Signed, ...]:
    commands = tuple([_signed(row) for row in arrays(raw, MAX_IN_TURN, field)])
    for signed in commands:
        decode_command(signed.body)
    return commands


class Turn(NamedTuple):
    """The operator has received everything up to `step` (-1: nothing yet), and gives these commands."""

    step: Annotated[int, Limits("the newest step received", -1, MAX_STEP)]
    commands: Annotated[tuple[Signed, ...], Limits("rows of body and signature", check=_commands)]


_TURN = Record(Turn, "turn")
encode_turn, decode_turn = _TURN.encode, _TURN.decode


class Pace(NamedTuple):
    """How fast the operator wants the steps: simulated seconds per wall second (0: as fast as the machine goes).

    The world does not begin step `hold_step` or a later one; -1: no limit.
    """

    speed: Annotated[float, Limits("simulated seconds per wall second", 0.0, 1e4)]
    hold_step: Annotated[int, Limits("the step that is not begun", -1, MAX_STEP + 1)]


_PACE = Record(Pace, "pace")
encode_pace, decode_pace = _PACE.encode, _PACE.decode


def forms_of(controller: Any) -> tuple[CommandForm, ...]:
    """The commands that a controller's class declares; none where it has no `Commands`.

    Raises:
        PluginError: they are no commands.
    """
    forms = getattr(controller, "Commands", ())
    if not isinstance(forms, tuple | list) or not all(isinstance(form, CommandForm) for form in forms):
        kind = controller if isinstance(controller, type) else type(controller)
        must = f"{kind.__module__}:{kind.__qualname__}.Commands must be a tuple of CommandForm (got {forms!r:.80})"
        raise PluginError(f"{must} ({defined_at(kind)})")
    return tuple(forms)


def named(forms: Sequence[CommandForm], name: str) -> CommandForm | None:
    """The form of a name, if there is one."""
    return next((form for form in forms if form.name == name), None)
