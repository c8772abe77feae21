"""Numbers the operator's commands, checks them against what the controller accepts, and counts agents' answers."""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from deltaswarm_scenario.person_tables import PERSON, SYSTEM, CommandRow
from deltaswarm_wire.commands import (
    AGENT,
    MAX_IN_TURN,
    TREE,
    Command,
    CommandForm,
    Signed,
    Target,
    Value,
    encode_command,
    named,
)
from deltaswarm_wire.operator_messages import DONE, HEARD, REFUSED, SUPERSEDED, Answer, Report

SENT, KNOWN, CARRIED_OUT, EXPIRED = "sent", "heard", "done", "expired"
LIFE_S = 120.0
MAX_QUEUE = 128
SHOWN = 50
MAX_REFUSERS = 8
"""Number of agents that refuse a command and are named at the station."""


@dataclass
class SentCommand:
    """A command, and the state that each answering agent reported."""

    command: Command
    sent_s: float
    by: str
    answers: dict[int, int] = field(default_factory=dict)

    def count(self, state: int) -> int:
        return list(self.answers.values()).count(state)

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of agents that know the command, and of those where it ended in one way or another."""
        ended = {"done": self.count(DONE), "refused": self.count(REFUSED), "superseded": self.count(SUPERSEDED)}
        return {"heard": len(self.answers), **ended}

    def state(self, now_s: float) -> str:
        if self.count(DONE):
            return CARRIED_OUT
        if self.answers:
            return KNOWN  # an agent may still be carrying it out, or report later
        return EXPIRED if now_s > self.sent_s + self.command.life_s else SENT


def _number(sent: SentCommand) -> int:
    return sent.command.number


class CommandLog:
    """All commands of one run, in order.

    Args:
        forms: the commands that the controller accepts.
        sign: signs an encoded command; default: no signature.
        wall_s: None: commands are numbered from 0. Otherwise a command's number is at least this clock's [s], so that
            agents that remember an earlier operator's commands take those of a later operator as new, and agents with a
            clock can tell how old a command is, also after this machine has slept or its clock was corrected.
    """

    def __init__(
        self,
        forms: Sequence[CommandForm],
        sign: Callable[[bytes], bytes] | None = None,
        wall_s: Callable[[], float] | None = None,
    ) -> None:
        self.sent: list[SentCommand] = []
        self.forms = forms
        self.next = 0
        """The least number of the next command."""
        self._sign = sign
        self._wall_s = wall_s
        self._queue: list[Command] = []
        self._heard: dict[int, tuple[Answer, ...]] = {}
        """What each agent answered last; most reports say the same as the one before."""
        self._under_way = 0
        """Number of commands that may still wait in the world, where at most `MAX_IN_TURN` leave per step."""

    @property
    def has_room(self) -> bool:
        return len(self._queue) + self._under_way < MAX_QUEUE

    def issue(
        self,
        name: str,
        target: Target,
        arguments: Mapping[str, Value],
        now_s: float,
        life_s: float = LIFE_S,
        *,
        by: str = PERSON,
    ) -> Command:
        form = named(self.forms, name)
        if form is None:
            known = ", ".join(form.name for form in self.forms) or "none"
            raise ValueError(f"the command must be one that the controller accepts: {known} (got {name!r:.40})")
        if problem := form.problem(target, arguments):
            raise ValueError(problem)
        if not self.has_room:
            raise ValueError(f"at most {MAX_QUEUE} commands may wait to be sent")
        command = Command(self._next_number(), name, target, dict(arguments), life_s)
        encode_command(command)
        self.next = command.number + 1
        self._queue.append(command)
        self.sent.append(SentCommand(command, now_s, by))
        return command

    def _next_number(self) -> int:
        return self.next if self._wall_s is None else max(self.next, int(self._wall_s()))

    def changes_by(self, by: str) -> int:
        """Count the commands of one source that differ from the one before."""
        arguments = [sent.command.arguments for sent in self.sent if sent.by == by]
        return sum(now != before for before, now in pairwise([None, *arguments]))

    def skip(self) -> None:
        """Skip the number of a command that is not given, so that later ones keep theirs."""
        self.next += 1

    def withdraw(self, number: int) -> None:
        """Take a command back that has not left yet, as if it had never been given."""
        self.sent = [sent for sent in self.sent if sent.command.number != number]
        self._queue = [command for command in self._queue if command.number != number]
        self._heard.clear()

    def take_unsent(self) -> tuple[Signed, ...]:
        """Take the commands of the next turn, encoded and signed."""
        taken, self._queue = self._queue[:MAX_IN_TURN], self._queue[MAX_IN_TURN:]
        self._under_way += len(taken)
        bodies = [encode_command(command) for command in taken]
        return tuple([Signed(body, self._sign(body) if self._sign else b"") for body in bodies])

    def close_step(self) -> None:
        self._under_way = max(0, self._under_way - MAX_IN_TURN)

    def hear(self, report: Report) -> None:
        if self._heard.get(report.agent) == report.answers:
            return
        self._heard[report.agent] = report.answers
        for number, state in report.answers:
            index = bisect_left(self.sent, number, key=_number)
            if index < len(self.sent) and _number(self.sent[index]) == number:
                answers = self.sent[index].answers  # a delayed report must not undo a state
                answers[report.agent] = max(state, answers.get(report.agent, HEARD))

    def rows(self, now_s: float) -> list[list[Any]]:
        """Return the newest commands and their outcomes for the station, which counts commands from 0."""
        rows = []
        for index, sent in [*enumerate(self.sent)][-SHOWN:]:
            command = sent.command
            expires_s = sent.sent_s + command.life_s
            target = [command.target.kind, *command.target.numbers]
            told = [index, command.name, target, command.arguments, sent.sent_s]
            heard, done, refused, superseded = sent.counts.values()
            refusers = sorted(agent for agent, state in sent.answers.items() if state == REFUSED)[:MAX_REFUSERS]
            outcome = [heard, done, refused, expires_s, sent.state(now_s), superseded, refusers]
            rows.append([*told, *outcome, sent.by])
        return rows

    def outcomes(self, now_s: float) -> dict[str, Any]:
        """Return the numbers of commands by outcome, without those of the system, for JSON."""
        states = [sent.state(now_s) for sent in self.sent if sent.by != SYSTEM]
        return {"commands_by_state": {state: states.count(state) for state in (SENT, KNOWN, CARRIED_OUT, EXPIRED)}}

    def table(self, now_s: float) -> list[CommandRow]:
        return [
            CommandRow(
                sent.command.number,
                sent.command.name,
                sent.sent_s,
                **sent.counts,
                state=sent.state(now_s),
                by=sent.by,
            )
            for sent in self.sent
        ]

    def described(self, now_s: float) -> list[dict[str, Any]]:
        return [
            {
                "number": sent.command.number,
                "name": sent.command.name,
                "target": str(sent.command.target),
                "sent_s": sent.sent_s,
                **sent.counts,
                "state": sent.state(now_s),
            }
            for sent in self.sent
        ]


def target_columns(target: Target) -> dict[str, Any]:
    """Return the columns of an act that say whom a command is for."""
    if target.kind in (AGENT, TREE):
        return {"target": target.kind, "agent": int(target.numbers[0])}
    return {"target": target.kind, **dict(zip(("x_m", "y_m", "radius_m"), target.numbers, strict=False))}
