"""The operator's console: picture, commands, pace and probes of one run, as a person or a script uses them.

Pure: arrivals in, turns and the station's datagrams out. `docs/STATION.md` describes the station's messages.
"""

import json
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import Any, NamedTuple

from deltaswarm_operator.core.command_log import CommandLog
from deltaswarm_operator.core.picture import Item, Picture, item_row
from deltaswarm_operator.core.probes import ISA, Probes
from deltaswarm_operator.core.simulated_operator import Read, SimulatedOperator
from deltaswarm_scenario.downlink import FIRST_STEP
from deltaswarm_scenario.operator_settings import DELTA, SET_DELTA, Briefing
from deltaswarm_wire.checked import plain
from deltaswarm_wire.commands import Pace, Target, Turn, make_target, named
from deltaswarm_wire.operator_messages import Clock, Report, Workload

LIVE = "live"
SPEEDS = (1, 2, 5, 10, 20, 50, 0)
INBOX_SHOWN, INBOX_CAUGHT_UP = 20, 1000
HISTORY_ROWS = 600
SHEET_FIELDS = ("consent", "participant", "condition")
MAX_NOTE = 2000
"""Characters."""
NO_CONSENT = "the run begins once the participant has consented"
RESIDUE_S = 60.0
"""An item unread for longer than this is residue of an earlier load [simulated s]."""


class OperatorAction(NamedTuple):
    """One act of a real, simulated or scripted person; `detail` is JSON."""

    time_s: float
    kind: str
    detail: str


def _person(briefing: Briefing) -> SimulatedOperator | None:
    """Make the simulated person that a briefing asks for, if any."""
    settings = briefing.operator.person
    if not settings.is_on:
        return None
    form = named(briefing.forms, SET_DELTA)
    first = next((argument.default for argument in form.arguments if argument.name == DELTA), None) if form else None
    rng = Random(f"deltaswarm/{briefing.seed}/person")
    delta = None if first is None else round(first)
    return SimulatedOperator(settings, rng, briefing.operator.threshold_hz, delta)


class Console:
    """One operator's console.

    Args:
        briefing: what the operator knows in advance.
        command_log: numbers and signs commands; default: numbers from 0, unsigned.
        in_air: whether in open air, where time has no pace and a command leaves the base at once.
    """

    def __init__(self, briefing: Briefing, command_log: CommandLog | None = None, *, in_air: bool = False) -> None:
        self.picture = Picture(briefing.step_s)
        self.command_log = command_log or CommandLog(briefing.forms)
        self.probes = Probes(briefing.operator.probes, Random(f"deltaswarm/{briefing.seed}/probes"))
        self.person = _person(briefing)
        self.pace = Pace(briefing.speed, -1)
        self.actions: deque[OperatorAction] = deque()
        """Acts not yet written down."""
        self.rejected = 0
        """Number of dropped intents of the station."""
        self._briefing = briefing
        self._in_air = in_air
        self._first_step = 1 if in_air else FIRST_STEP
        self._script = deque(sorted(briefing.command, key=lambda command: command.at_s))
        self._step = -1
        self._is_over = False
        self._workload: Workload | None = None
        self._messages = 0
        self._steps_above = [0 for _ in self._thresholds]
        self._history: deque[tuple[float, float, float]] = deque(maxlen=HISTORY_ROWS)
        self._shown = 0

    @property
    def _thresholds(self) -> list[float]:
        return [self._briefing.operator.threshold_hz, *self._briefing.operator.more_thresholds_hz]

    def start(self, wall_s: float) -> None:
        """Before the first step, open the session's sheet, which holds the run back until it is filled in."""
        self.probes.start(wall_s)
        if self.probes.open(wall_s):
            self.pace = self.pace._replace(hold_step=0)

    def close_step(self, clock: Clock, workload: Workload, reports: Sequence[Report], wall_s: float) -> Turn:
        """Take in a closed step; return the operator's turn."""
        self._step, self._is_over, self._workload = clock.step, clock.last, workload
        self.command_log.close_step()
        for report in reports:
            self.command_log.hear(report)
        items = self.picture.update(reports, clock.time_s)
        self._messages += workload.messages
        for index, threshold_hz in enumerate(self._thresholds):
            self._steps_above[index] += workload.rate_60s_hz > threshold_hz
        self._history.append((clock.time_s, round(workload.rate_1s_hz, 3), round(workload.rate_60s_hz, 3)))
        self.probes.tick(clock.time_s, clock.last, wall_s)
        self._follow_script(clock.step + self._first_step)
        if self.person is not None:
            self._act_as(self.person, items, workload.rate_60s_hz, wall_s)
        return self.turn()

    def turn(self) -> Turn:
        """Return the turn with the commands given so far."""
        return Turn(self._step, self.command_log.take_unsent())

    def _follow_script(self, step: int) -> None:
        """Give the script's commands for this step; those that are too early leave in the first possible step."""
        while self._is_scripted(step) and self.command_log.has_room:
            scripted = self._script.popleft()
            target = Target(scripted.target, scripted.numbers)
            self._command(scripted.name, target, scripted.arguments, scripted.life_s)

    def _act_as(self, person: SimulatedOperator, items: Sequence[Item], rate_hz: float, wall_s: float) -> None:
        """Carry out the simulated person's acts up to now."""
        for act in person.live(self.picture.now_s, items, rate_hz):
            if isinstance(act, Read):
                self._note("read", self.picture.read(act.numbers))
            else:
                self._command(SET_DELTA, Target(), {DELTA: act.delta})
        asked = self.probes.open(wall_s)
        if asked is not None and asked["kind"] == ISA:
            self.probes.answer_isa(asked["number"], person.answer_isa(), wall_s)
            self._note(ISA, person.isa)

    @property
    def totals(self) -> dict[str, Any]:
        """The metrics of the simulated person, for JSON; empty without one."""
        return {} if self.person is None else {"person": self.person.totals}

    def _command(self, name: str, target: Target, arguments: Mapping[str, Any], *life_s: float) -> int:
        command = self.command_log.issue(name, target, arguments, self.picture.now_s, *life_s)
        self._note("command", [command.number, name, [target.kind, *target.numbers], dict(arguments), command.life_s])
        return len(self.command_log.sent) - 1

    def _note(self, kind: str, detail: Any) -> None:
        self.actions.append(OperatorAction(self.picture.now_s, kind, json.dumps(detail)))

    def _is_scripted(self, step: int) -> bool:
        """Whether the script's next command is due in this step or before."""
        return bool(self._script) and round(self._script[0].at_s / self._briefing.step_s) <= step

    def state(self) -> dict[str, Any]:
        """Return all that is needed to resume, for JSON."""
        return {
            "commands": self.command_log.state(),
            "script": len(self._script),
            "pace": list(self.pace),
            "probes": self.probes.state(),
            "picture": self.picture.state(),
            "messages": self._messages,
            "steps_above": self._steps_above,
            "history": list(self._history),
            "person": None if self.person is None else self.person.state(),
        }

    def restore(self, step: int, state: Mapping[str, Any]) -> None:
        """Resume after a step from another console's `state`."""
        self._step = step
        self.command_log.restore(state["commands"])
        if self.person is not None:
            self.person.restore(state["person"])
        self.picture.restore(state["picture"])
        self._messages, self._steps_above = state["messages"], list(state["steps_above"])
        self._history.extend((time_s, short_hz, long_hz) for time_s, short_hz, long_hz in state["history"])
        while len(self._script) > state["script"]:
            self._script.popleft()
        self.pace = Pace(*state["pace"])
        self.probes.restore(state["probes"])

    # The station

    def hello(self, run: str, kind: str = LIVE, speeds: Sequence[float] = SPEEDS) -> bytes:
        """Return the message that describes the run to the page."""
        briefing = self._briefing
        probes = briefing.operator.probes
        return _json(
            type="hello",
            kind=kind,
            run=run,
            title=briefing.title,
            step_s=briefing.step_s,
            duration_s=briefing.duration_s,
            arena_m=[briefing.width_m, briefing.height_m],
            obstacles=[[list(corner) for corner in obstacle.corners_m] for obstacle in briefing.obstacles],
            base_m=briefing.base_m,
            range_m=briefing.range_m,
            agents=briefing.agents,
            thresholds_hz=self._thresholds,
            commands=[plain(form) for form in briefing.forms],
            speeds=() if self._in_air else speeds,
            session={
                "sheet": {name: getattr(probes, name) for name in SHEET_FIELDS} if probes.has_sheet else None,
                "asks": {"isa": probes.isa_every_s > 0, "tlx": probes.tlx, "weights": probes.tlx_weights},
            },
        )

    def show(self, wall_s: float, **more: Any) -> bytes:
        """Return the newest picture."""
        picture, workload = self.picture, self._workload
        first = min(self._shown, max(0, len(picture.inbox) - INBOX_SHOWN))  # also after a replay went back
        self._shown = len(picture.inbox)
        above_s = [steps * self._briefing.step_s for steps in self._steps_above]
        told = dict(
            type="picture",
            step=self._step,
            time_s=round(picture.now_s, 3),
            over=self._is_over,
            **picture.rows(),
            inbox=_rows(picture.inbox[max(first, len(picture.inbox) - INBOX_CAUGHT_UP) :]),
            unread=len(picture.unread),
            closed={"events": len(picture.closed), "after_s": round(picture.closed_after_s or 0.0, 1)},
            workload={
                "messages": self._messages,
                "rate_1s_hz": round(workload.rate_1s_hz, 3) if workload else 0.0,
                "rate_60s_hz": round(workload.rate_60s_hz, 3) if workload else 0.0,
                "senders": workload.senders if workload else 0,
                "residue": picture.waiting(RESIDUE_S),
                "above_s": above_s,
            },
            commands=self.command_log.rows(picture.now_s),
            pace={"paused": self.pace.hold_step >= 0, "speed": self.pace.speed},
            probe=self.probes.open(wall_s),
        )
        return _json(**{**told, **more})

    def intend(self, data: bytes, wall_s: float) -> list[bytes]:
        """Carry out an intent of the station; return the answers."""
        try:
            raw = json.loads(data)
        except ValueError:
            raw = None
        kind = raw.get("type") if isinstance(raw, dict) else None
        act = self._intents.get(kind) if isinstance(kind, str) else None
        if act is None:
            self.rejected += 1
            return []
        to = raw.get("from")
        try:
            return act(self, raw, to, wall_s)
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
            self.rejected += 1
            why = str(error) if isinstance(error, ValueError) else f"{kind}: something is missing or wrong"
            return [_json(type="refused", to=to, id=str(raw.get("id", kind))[:64], why=why)]

    def _intend_command(self, raw: dict[str, Any], to: Any, wall_s: float) -> list[bytes]:
        target = raw["target"]
        fields = {"circle": ("x_m", "y_m", "radius_m"), "tree": ("root",), "agent": ("agent",), "place": ("x_m", "y_m")}
        numbers = [target[field] for field in fields.get(target["kind"], ())]
        number = self._command(raw["name"], make_target([target["kind"], *numbers]), raw.get("arguments", {}))
        return [_json(type="accepted", to=to, id=str(raw.get("id", ""))[:64], number=number)]

    def _intend_pace(self, raw: dict[str, Any], to: Any, wall_s: float) -> list[bytes]:
        if self._in_air:
            raise ValueError("in open air the pace cannot be set")
        if self.probes.is_sheet_open and "speed" not in raw:
            raise ValueError(NO_CONSENT)
        if "speed" in raw:
            speed = float(raw["speed"])
            if not 0.0 <= speed <= 1000.0:
                raise ValueError(f"the speed must be from 0 to 1000 (got {speed:.15g})")
            self.pace = self.pace._replace(speed=speed)
        elif "steps" in raw:
            steps = int(raw["steps"])
            if not 1 <= steps <= 10_000:
                raise ValueError(f"the number of steps must be from 1 to 10,000 (got {steps})")
            self.pace = self.pace._replace(hold_step=self._step + 1 + steps)
        else:
            self.pace = self.pace._replace(hold_step=self._step + 1 if raw["paused"] else -1)
        self._note("pace", {name: raw[name] for name in ("speed", "steps", "paused") if name in raw})
        return []

    def _intend_read(self, raw: dict[str, Any], to: Any, wall_s: float) -> list[bytes]:
        numbers = list(self.picture.unread) if raw.get("all") else [int(number) for number in raw["items"]]
        fresh = self.picture.read(numbers)
        if fresh:
            self._note("read", fresh)
        return [_json(type="read", items=fresh)]

    def _intend_isa(self, raw: dict[str, Any], to: Any, wall_s: float) -> list[bytes]:
        self.probes.answer_isa(raw["number"], raw["answer"], wall_s)
        self._note("isa", raw["answer"])
        return []

    def _intend_tlx(self, raw: dict[str, Any], to: Any, wall_s: float) -> list[bytes]:
        self.probes.answer_tlx(raw["scales"], raw.get("weights"), wall_s)
        self._note("tlx", raw["scales"])
        return []

    def _intend_note(self, raw: dict[str, Any], to: Any, wall_s: float) -> list[bytes]:
        self._note("note", str(raw["text"])[:MAX_NOTE])
        return []

    def _intend_sheet(self, raw: dict[str, Any], to: Any, wall_s: float) -> list[bytes]:
        if raw.get("consent") is not True:
            raise ValueError(NO_CONSENT)
        self.probes.take_sheet()
        self._note("sheet", {name: str(raw.get(name, ""))[:64] for name in ("participant", "condition")})
        self.pace = self.pace._replace(hold_step=-1)
        return []

    def _intend_catch_up(self, raw: dict[str, Any], to: Any, wall_s: float) -> list[bytes]:
        newest = self.picture.inbox[-INBOX_CAUGHT_UP:]
        read = [item.number for item in newest if item.number not in self.picture.unread]
        return [_json(type="catch_up", to=to, inbox=_rows(newest), read=read, history=list(self._history))]

    _intents: Mapping[str, Callable[["Console", dict[str, Any], Any, float], list[bytes]]] = {
        "command": _intend_command,
        "pace": _intend_pace,
        "read": _intend_read,
        "isa": _intend_isa,
        "tlx": _intend_tlx,
        "note": _intend_note,
        "sheet": _intend_sheet,
        "catch_up": _intend_catch_up,
    }


def _rows(items: Sequence[Item]) -> list[list[Any]]:
    return [item_row(item) for item in items]


def _json(**message: Any) -> bytes:
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
