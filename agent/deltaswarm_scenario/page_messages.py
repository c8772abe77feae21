"""Define every message between a feed and the station's page: who sends it, its fields, their types and bounds.

A feed is what a page shows: the operator's console, a replay, or the researcher's view. Every feed and the station's
process check messages by these tables; the page's types and the tables of docs/STATION.md are written from them by
`docs/extensions/page_messages.py`. This file imports no other part, since the station knows nothing of a run.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

Message = dict[str, Any]

PARTICIPANT, WATCHER, CONDUCTOR = "participant", "watcher", "conductor"
RESEARCHER, REPLAY = "researcher", "replay"

WHY_NOT: Mapping[str, str] = {
    PARTICIPANT: "a message of this type is for replays",
    WATCHER: "this address only watches",
    CONDUCTOR: "the conductor may pause, end the run, answer a call for help and write notes, and nothing else",
    RESEARCHER: "the researcher's view only looks on",
    REPLAY: "this is a replay: nothing can be commanded or answered",
}
"""What each page is told that sends what another page may send."""

EVERYBODY = tuple(WHY_NOT)

MAX_BYTES = 128 * 1024
"""Longest message of a page: a form with 20 long texts fits. The page sends nothing longer."""
MAX_DATAGRAM_BYTES = MAX_BYTES + 1024
"""The same with what the station adds."""

MAX_NOTE, MAX_PAGE_TEXT, MAX_CODE = 2000, 200, 64
"""Characters; what is longer is cut off."""

REQUIRED, LEFT_OUT = object(), object()


@dataclass(frozen=True)
class Field:
    """One field of a message: its type in TypeScript, and its default, if the sender may leave it out.

    Of a page's message, numbers must be from `low` to `high`, and texts are cut after `most` characters.
    """

    type: str
    default: Any = REQUIRED
    """REQUIRED, or LEFT_OUT, or what stands in the place of a missing field."""
    low: float = -math.inf
    high: float = math.inf
    most: int = MAX_CODE

    @property
    def is_required(self) -> bool:
        return self.default is REQUIRED

    def checked(self, value: Any, name: str) -> Any:
        """Return a page's value. Raises RefusedError: it is of another type or out of bounds."""
        if self.type in ("number", "integer"):
            is_number = type(value) is int or (type(value) is float and self.type == "number")
            if not is_number or not self.low <= value <= self.high or not abs(value) < math.inf:
                raise RefusedError(f"a message's {name} must be {self.described} (got {value!r:.40})")
            return value
        if self.type == "string":
            if not isinstance(value, str) or not _is_text(value):
                raise RefusedError(f"a message's {name} must be text")
            return value[: self.most]
        is_right = isinstance(value, {"boolean": bool, "integer[]": list}.get(self.type, dict))
        if not is_right or (self.type == "integer[]" and any(type(item) is not int for item in value)):
            raise RefusedError(f"a message's {name} must be {self.described}")
        return value

    @property
    def described(self) -> str:
        if self.type in ("number", "integer"):
            kind = "an integer" if self.type == "integer" else "a number"
            return kind if self.high == math.inf else f"{kind} from {self.low:,g} to {self.high:,g}"
        if self.type == "string":
            return f"text of at most {self.most:,} characters"
        return {"boolean": "true or false", "integer[]": "a list of integers"}.get(self.type, "an object")


@dataclass(frozen=True)
class MessageForm:
    """One type of message. `pages` send it, or receive it; a notice without an id is refused without an answer."""

    meaning: str
    pages: tuple[str, ...]
    fields: Mapping[str, Field]
    is_notice: bool = False
    is_input: bool = False
    """Whether a person means it: it has the fields of `INPUT` too, and counts once."""


NUMBER, TEXT, FLAG = Field("number"), Field("string", most=MAX_PAGE_TEXT), Field("boolean")
INTEGER, INTEGERS = Field("integer"), Field("integer[]")

PAGE_CLOCK = Field("number", LEFT_OUT, 0, 1e12)

INPUT: Mapping[str, Field] = {"id": Field("string", LEFT_OUT), "page_s": PAGE_CLOCK, "sent_s": PAGE_CLOCK}
"""Fields of every input: its id, which returns with the answer, and the page's clock when it was made and sent [s].

An input that is sent again has its id again, and counts once.
"""

SHOWN: Mapping[str, Field] = {"shown_s": PAGE_CLOCK}
"""Field of an answer: the page's clock when the question was first painted [s]."""

FROM_PAGE: Mapping[str, MessageForm] = {
    "command": MessageForm(
        "an order",
        (PARTICIPANT,),
        {"name": TEXT, "target": Field("Target"), "arguments": Field("Record<string, unknown>", LEFT_OUT)},
        is_input=True,
    ),
    "veto": MessageForm(
        "drop the change of delta that the system proposes",
        (PARTICIPANT,),
        {"delta": Field("integer", LEFT_OUT)},
        is_input=True,
    ),
    "judge": MessageForm(
        "what a reported event is judged to be", (PARTICIPANT,), {"event": INTEGER, "answer": TEXT}, is_input=True
    ),
    "pace": MessageForm(
        "a speed, a number of steps, or a pause and its end; below 0 in a replay only",
        (PARTICIPANT, CONDUCTOR, REPLAY),
        {
            "speed": Field("number", LEFT_OUT, -1000, 1000),
            "steps": Field("integer", LEFT_OUT, -10_000, 10_000),
            "paused": Field("boolean", LEFT_OUT),
        },
        is_input=True,
    ),
    "read": MessageForm(
        "items of the inbox that were read; `all`: all `up_to` the newest one that the page has",
        (PARTICIPANT, REPLAY),
        {
            "items": Field("integer[]", LEFT_OUT),
            "all": Field("boolean", LEFT_OUT),
            "up_to": Field("integer", LEFT_OUT),
        },
        is_input=True,
    ),
    "held": MessageForm("asks for the items of the inbox that are held back", (PARTICIPANT, CONDUCTOR), {}),
    "isa": MessageForm(
        "an answer to ISA",
        (PARTICIPANT,),
        {"number": INTEGER, "answer": Field("integer", low=1, high=5), **SHOWN},
        is_input=True,
    ),
    "tlx": MessageForm(
        "NASA-TLX filled in",
        (PARTICIPANT,),
        {"scales": Field("Record<string, number>"), "weights": Field("Record<string, number>", LEFT_OUT), **SHOWN},
        is_input=True,
    ),
    "form": MessageForm(
        "a form filled in",
        (PARTICIPANT,),
        {"form": TEXT, "number": Field("integer", LEFT_OUT), "answers": Field("Record<string, unknown>"), **SHOWN},
        is_input=True,
    ),
    "ready": MessageForm(
        "the person is ready for the question that a prompt announces",
        (PARTICIPANT,),
        {"form": TEXT, "number": INTEGER, **SHOWN},
        is_input=True,
    ),
    "note": MessageForm("a note", (PARTICIPANT, CONDUCTOR), {"text": Field("string", most=MAX_NOTE)}, is_input=True),
    "help": MessageForm(
        "a call for help (`asked`), the conductor's answer that somebody comes (`seen`), or its end (`over`)",
        (PARTICIPANT, CONDUCTOR),
        {"state": TEXT},
        is_input=True,
    ),
    "end": MessageForm("end the run now; it is not complete", (CONDUCTOR,), {}, is_input=True),
    "page": MessageForm(
        "what happened to the page",
        (PARTICIPANT,),
        {"event": TEXT, "text": Field("string", LEFT_OUT, most=MAX_PAGE_TEXT)},
        is_notice=True,
        is_input=True,
    ),
    "beat": MessageForm(
        "the page is there; once a second. `rtt_s`: how long the answer to one took; `done`: it has shown the end "
        "of the run, and has nothing left to send",
        (PARTICIPANT,),
        {
            "number": Field("integer", LEFT_OUT),
            "rtt_s": Field("number", LEFT_OUT, 0, 600),
            "done": Field("boolean", LEFT_OUT),
        },
        is_notice=True,
    ),
    "sheet": MessageForm(
        "the session's sheet filled in",
        (PARTICIPANT,),
        {"consent": FLAG, "participant": Field("string", LEFT_OUT), "condition": Field("string", LEFT_OUT)},
        is_input=True,
    ),
    "catch_up": MessageForm("a page was loaded, and asks for what it missed", EVERYBODY, {}),
    "seek": MessageForm("go to a time", (REPLAY,), {"time_s": Field("number", low=0, high=1e9)}),
}
"""The messages that pages send, by type."""

TO_PAGE: Mapping[str, MessageForm] = {
    "hello": MessageForm(
        "the run, the arena, the base, the thresholds, the forms of the orders, the questions, the translations",
        EVERYBODY,
        {
            "kind": Field('"live" | "replay" | "researcher" | "conductor" | "watch"'),
            "run": TEXT,
            "title": TEXT,
            "step_s": NUMBER,
            "duration_s": NUMBER,
            "arena_m": Field("Point"),
            "obstacles": Field("Point[][]"),
            "base_m": Field("Point | null"),
            "range_m": Field("number | null"),
            "radius_m": Field("number", 0.0),
            "agents": INTEGER,
            "thresholds_hz": Field("number[]"),
            "inbox": Field("{ policy: string; order: string; held: string }", LEFT_OUT),
            "event_numbers": Field("[number, number][]", ()),
            "commands": Field("Form[]", ()),
            "goal": Field("string", ""),
            "sets_delta": Field('"operator" | "swarm" | "system" | "budget"', LEFT_OUT),
            "speeds": Field("number[]", ()),
            "layers": Field("string[]", LEFT_OUT),
            "panels": Field("string[]", LEFT_OUT),
            "place": Field("number[]", ()),
            "asks": Field("boolean", False),
            "end_text": Field("string", ""),
            "worth": Field("Record<string, string>", LEFT_OUT),
            "language": Field("Language | null", None),
            "session": Field("Session | null", None),
        },
    ),
    "picture": MessageForm(
        "at most ten times per second: agents, events, the number of events that are no longer reported and how long "
        "they were reported, new inbox items, workload, status of the orders, pace, the open question",
        EVERYBODY,
        {
            "step": INTEGER,
            "time_s": NUMBER,
            "over": FLAG,
            "agents": Field("AgentRow[]", ()),
            "events": Field("EventRow[]", ()),
            "inbox": Field("InboxRow[]", ()),
            "counts": Field("[number, number][]", ()),
            "judged": Field("[number, string][]", ()),
            "held": Field("[number, number, number | null]", LEFT_OUT),
            "unread": Field("integer", 0),
            "closed": Field("{ events: number; after_s: number }", LEFT_OUT),
            "workload": Field("Workload"),
            "commands": Field("CommandRow[]", ()),
            "pace": Field("{ paused: boolean; speed: number }", {"paused": False, "speed": 0.0}),
            "probe": Field("Probe | null", None),
            "proposal": Field("{ delta: number; left_s: number } | null", None),
            "help": Field('"asked" | "seen" | "over"', "over"),
            "next": Field("{ what: string; at_s: number } | null", LEFT_OUT),
            "replay": Field("{ from_s: number; to_s: number; speed: number; paused: boolean }", LEFT_OUT),
            "truth": Field("Truth | null", LEFT_OUT),
            "status": Field("Record<string, unknown>", LEFT_OUT),
        },
    ),
    "catch_up": MessageForm(
        "the inbox and the history of rates, for a newly loaded page; to the conductor, the participant's acts",
        EVERYBODY,
        {
            "inbox": Field("InboxRow[]", ()),
            "counts": Field("[number, number][]", ()),
            "read": Field("integer[]", ()),
            "history": Field("HistoryRow[]", ()),
            "acts": Field("Act[]", LEFT_OUT),
        },
    ),
    "held": MessageForm(
        "the newest items of the inbox that are held back", (PARTICIPANT, CONDUCTOR), {"inbox": Field("InboxRow[]", ())}
    ),
    "accepted": MessageForm("the answer to an order", (PARTICIPANT,), {"id": TEXT, "number": INTEGER}),
    "beat": MessageForm(
        "the answer to a beat, with its number: both ways of the connection work",
        (PARTICIPANT,),
        {"number": Field("integer", LEFT_OUT)},
    ),
    "noted": MessageForm(
        "an input is written down, so that nothing loses it any more", (PARTICIPANT, CONDUCTOR), {"id": TEXT}
    ),
    "refused": MessageForm(
        "what is not accepted, by its `id` or its type, and why; `again`: not now, but perhaps later",
        EVERYBODY,
        {"id": Field("string | null"), "why": TEXT, "again": Field("boolean", LEFT_OUT)},
    ),
    "read": MessageForm("items marked as read", (PARTICIPANT, WATCHER, CONDUCTOR, REPLAY), {"items": INTEGERS}),
    "act": MessageForm("what the participant did or answered", (CONDUCTOR,), {"act": Field("Act")}),
    "acts": MessageForm(
        "what the participant did and answered in the run that is replayed; with `is_first`, what was told before goes",
        (REPLAY,),
        {"acts": Field("Act[]"), "is_first": FLAG},
    ),
    "truth": MessageForm(
        "from the orchestrator: agents and events as they are",
        (CONDUCTOR,),
        {"time_s": NUMBER, "agents": Field('Truth["agents"]'), "events": Field('Truth["events"]')},
    ),
    "role": MessageForm("from the station: this page only watches", (WATCHER,), {"role": Field('"watch"')}),
    "ended": MessageForm("the run has ended; another one may follow", EVERYBODY, {}),
    "moved": MessageForm("from the station: what follows is at another address", EVERYBODY, {"address": TEXT}),
}
"""The messages that pages receive, by type."""


class RefusedError(ValueError):
    """A page's message that is not accepted; the text is for the page."""

    def __init__(self, why: str, what: str | None = None, *, is_notice: bool = False, again: bool = False) -> None:
        super().__init__(why)
        self.what = what
        """What is refused: the message's own id, or else its type."""
        self.again = again
        """Whether it may be accepted if it is sent again."""
        self.is_notice = is_notice
        """Whether nobody waits for an answer."""


def checked(raw: Any, page: str | None = None) -> Message:
    """Return a page's decoded message with the fields of its type and the number of its browser (`from`).

    `page` is the page that sent it; None: any. Raises RefusedError if the type is unknown or not for this page, or a
    field is missing or wrong.
    """
    if not isinstance(raw, dict):
        raise RefusedError("a message must be a JSON object")
    kind, what = raw.get("type"), name_of(raw)
    form = FROM_PAGE.get(kind) if isinstance(kind, str) else None
    if form is None:
        raise RefusedError(f"a message's type must be one of {', '.join(sorted(FROM_PAGE))}", what)
    is_notice = form.is_notice and not raw.get("id")  # a page sends an input with an id again until it is answered
    if page is not None and page not in form.pages:
        raise RefusedError(WHY_NOT[page], what, is_notice=is_notice)
    message = {"type": kind, "from": raw.get("from") if type(raw.get("from")) is int else None}
    try:
        for name, field in {**form.fields, **(INPUT if form.is_input else {})}.items():
            if raw.get(name) is not None:
                message[name] = field.checked(raw[name], name)
            elif field.is_required:
                raise RefusedError(f"a message of type {kind} must have the field {name}")
    except RefusedError as error:
        raise RefusedError(str(error), what, is_notice=is_notice) from None
    return message


def name_of(raw: Mapping[str, Any]) -> str | None:
    """Return what a refusal of a message names: its own id, or else its type."""
    found = raw.get("id") or raw.get("type")
    return found[:MAX_CODE] if isinstance(found, str) and _is_text(found) else None


def answers(data: bytes, page: str, carry_out: Callable[[Message], Iterable[Message]]) -> list[Message]:
    """Carry out what a page sent to its feed; return the answers, a refusal if it is not accepted.

    An answer without `to` is for every page. What names no browser gets no answer of its own.
    """
    raw: Any = None
    try:
        raw = json.loads(data)
        return list(carry_out(checked(raw, page)))
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        to = raw.get("from") if isinstance(raw, dict) else None
        if type(to) is not int or (isinstance(error, RefusedError) and error.is_notice):
            return []
        why = str(error) if isinstance(error, ValueError) else "a message's target must be complete"
        return [made("refused", to=to, id=name_of(raw), why=why)]


def made(kind: str, /, *, to: int | None = None, **fields: Any) -> Message:
    """Make a message to the page with the defaults of its type; `to`: one browser, default all."""
    form = TO_PAGE[kind].fields
    if wrong := (fields.keys() - form.keys()) | {name for name, one in form.items() if one.is_required} - fields.keys():
        raise TypeError(f"{kind} is no message with and without {', '.join(sorted(wrong))}")
    message = {"type": kind} | ({} if to is None else {"to": to})
    for name, field in form.items():
        value = fields.get(name, field.default)
        if value is not LEFT_OUT:
            message[name] = value
    return message


def _is_text(value: str) -> bool:
    """Whether a text can be written to a file: JSON may hold half of a surrogate pair."""
    return not any("\ud800" <= character <= "\udfff" for character in value)
