"""Carry out what the participant or the conductor wants at the station: orders, pace, answers, notes.

Pure: the page's messages in, answers out. `page_messages.FROM_PAGE` defines the messages.
"""

from collections.abc import Callable, Mapping
from hashlib import sha256
from typing import Any

from deltaswarm_operator.core.asked_question import delay_s
from deltaswarm_operator.core.console import (
    HELP_ASKED,
    HELP_OVER,
    HELP_SEEN,
    INBOX_CAUGHT_UP,
    Console,
)
from deltaswarm_operator.core.hello import is_refused
from deltaswarm_operator.inbox.item import item_row
from deltaswarm_scenario.page_messages import PARTICIPANT, Message, answers, made
from deltaswarm_scenario.person_tables import CONDUCTOR, PERSON
from deltaswarm_scenario.task import CLASSES
from deltaswarm_wire.commands import make_target, named

NO_CONSENT = "the run begins once the participant has consented"
TARGET_FIELDS = {
    "circle": ("x_m", "y_m", "radius_m"),
    "tree": ("root",),
    "agent": ("agent",),
    "place": ("x_m", "y_m"),
}

Raw = Mapping[str, Any]


def carry_out(console: Console, data: bytes, wall_s: float, by: str = PERSON) -> list[Message]:
    """Carry out what a page of the participant or the conductor sent; return the answers.

    An answer without `to` is for every page. An input that was carried out before is only answered again.
    """

    def act(raw: Message) -> list[Message]:
        code, page = raw.get("id", ""), raw["from"]
        if by == PERSON and (raw["type"] != "page" or code):  # else the station tells of a page that comes or goes
            console.beat(wall_s)
        if code in console.inputs:
            return [{**answer, "to": page} for answer in console.inputs[code]]
        by_page = {"page_s": raw["page_s"], "delay_s": delay_s(raw)} if "page_s" in raw else {}
        at = {"by": by, "monotonic_s": wall_s, "page": page, "input": code, **by_page}
        answered = INTENTS[raw["type"]](console, raw, at)
        if code:
            answered.append(made("noted", to=page, id=code))
            console.remember(code, [answer for answer in answered if "to" in answer])
        return answered

    return answers(data, CONDUCTOR if by == CONDUCTOR else PARTICIPANT, act)


def _command(console: Console, raw: Raw, at: Raw) -> list[Message]:
    if console.probes.is_sheet_open:
        raise ValueError(NO_CONSENT)
    target, offered = raw["target"], console.briefing.offered
    form = named(offered, raw["name"])
    if form is None:
        names = ", ".join(form.name for form in offered)
        raise ValueError(f"the order must be one that this run offers: {names or 'none'}")
    if is_refused(console, form):
        raise ValueError(f"no agent carries out {form.name} in this run")
    numbers = [target[field] for field in TARGET_FIELDS.get(target["kind"], ())]
    aim = make_target([target["kind"], *numbers])
    number = console.command(name=raw["name"], target=aim, arguments=raw.get("arguments", {}), **at)
    return [made("accepted", to=at["page"], id=raw.get("id", ""), number=number)]


def _pace(console: Console, raw: Raw, at: Raw) -> list[Message]:
    if console.in_air:
        raise ValueError("in open air the pace cannot be set")
    if at["by"] == PERSON and not console.briefing.operator.page.pace:
        raise ValueError("in this run the pace cannot be set")
    if console.probes.holds_run and "speed" not in raw:
        raise ValueError(
            NO_CONSENT if console.probes.is_sheet_open else "the run goes on once the question is answered"
        )
    value = None
    if "speed" in raw:
        name, value = "speed", float(raw["speed"])
        if value < 0.0:
            raise ValueError("a message's speed must be at least 0")
        pace = console.pace._replace(speed=value)
    elif "steps" in raw:
        name, steps = "step", raw["steps"]
        if steps < 1:
            raise ValueError("a message's steps must be at least 1")
        value = float(steps)
        ends = (console.step + 1 + steps, console.next_hold_step)
        pace = console.pace._replace(hold_step=min(end for end in ends if end >= 0))
    elif "paused" not in raw:
        raise ValueError("a message of type pace must have speed, steps or paused")
    else:
        name = "pause" if raw["paused"] else "resume"
        pace = console.pace._replace(hold_step=console.step + 1 if raw["paused"] else console.next_hold_step)
    console.set_pace(pace, at["monotonic_s"])
    console.note(kind="pace", name=name, value=value, **at)
    return []


def _veto(console: Console, raw: Raw, at: Raw) -> list[Message]:
    if console.autonomy is None:
        raise ValueError("in this run the system does not set delta")
    console.note(kind="veto", value=console.autonomy.veto(raw.get("delta")), **at)
    return []


def _judge(console: Console, raw: Raw, at: Raw) -> list[Message]:
    if not console.briefing.operator.task.is_on:
        raise ValueError("in this run events are not judged")
    made_wall_s = at["monotonic_s"] - at.get("delay_s", 0.0) - console.probes.grace_s
    if console.over_wall_s is not None and made_wall_s > console.over_wall_s:
        raise ValueError("the run is over")
    event, answer = raw["event"], raw["answer"]
    if answer not in CLASSES:
        raise ValueError(f"the answer must be {' or '.join(CLASSES)} (got {answer!r})")
    if event not in console.picture.events and event not in console.picture.closed:
        raise ValueError(f"event {event} must be one that was reported")
    console.judge(event, answer)
    console.note(kind="judge", name=answer, event=event, **at)
    return []


def _read(console: Console, raw: Raw, at: Raw) -> list[Message]:
    ledger, items = console.ledger, raw.get("items", ())
    if raw.get("all"):
        items = ledger.listed[: raw.get("up_to", len(ledger.listed)) + 1]
    fresh = ledger.read(ledger.on_lines(items), console.picture.now_s)
    if fresh:
        if console.attention is not None:
            console.attention.read(fresh, console.picture.now_s, at["monotonic_s"])
        console.note(kind="read", items=" ".join(map(str, fresh)), **at)
    return [made("read", items=fresh)]


def _held(console: Console, raw: Raw, at: Raw) -> list[Message]:
    rows = [item_row(item, -1) for item in console.ledger.held_items[-INBOX_CAUGHT_UP:]]
    return [made("held", to=at["page"], inbox=rows)]


def _answer(console: Console, raw: Raw, at: Raw) -> list[Message]:
    columns, was_held = console.probes.answer(raw, at["monotonic_s"])
    console.note(kind=raw["type"], **columns, **at)
    if was_held:
        console.go_on(at["monotonic_s"])
    return []


def _ready(console: Console, raw: Raw, at: Raw) -> list[Message]:
    console.probes.be_ready(raw, console.picture.now_s, at["monotonic_s"], console.see())
    console.note(kind="ready", name=raw["form"], **at)
    return []


def _note(console: Console, raw: Raw, at: Raw) -> list[Message]:
    console.note(kind="note", text=raw["text"], **at)
    return []


def _help(console: Console, raw: Raw, at: Raw) -> list[Message]:
    state = raw["state"]
    if state not in ((HELP_SEEN, HELP_OVER) if at["by"] == CONDUCTOR else (HELP_ASKED, HELP_OVER)):
        raise ValueError(f"a message's state must be {HELP_ASKED}, {HELP_SEEN} or {HELP_OVER}, as the page may say")
    if not console.has_conductor:
        raise ValueError("nobody conducts this run")
    console.set_help(state)
    console.note(kind="help", name=state, **at)
    return []


def _end(console: Console, raw: Raw, at: Raw) -> list[Message]:
    console.end()
    console.note(kind="end", **at)
    return []


def _page(console: Console, raw: Raw, at: Raw) -> list[Message]:
    console.note(kind="page", name=raw["event"], text=raw.get("text", ""), **at)
    return []


def _beat(console: Console, raw: Raw, at: Raw) -> list[Message]:
    if "rtt_s" in raw:
        console.know_link(raw["rtt_s"], is_done=raw.get("done", False))
    return [made("beat", to=at["page"], **({"number": raw["number"]} if "number" in raw else {}))]


def _sheet(console: Console, raw: Raw, at: Raw) -> list[Message]:
    if not raw["consent"]:
        raise ValueError(NO_CONSENT)
    probes = console.briefing.operator.probes
    given = {name: raw.get(name, "") for name in ("participant", "condition")}
    for name, value in given.items():
        if (planned := getattr(probes, name)) and value != planned:
            raise ValueError(f"the {name} must be {planned}, as planned (got {value!r})")
    console.probes.answer(raw, at["monotonic_s"])
    if probes.consent:
        shown = console.briefing.operator.page.language.of(probes.consent)
        given["consent_sha256"] = sha256(shown.encode()).hexdigest()
    console.note(kind="sheet", text="; ".join(f"{name}={value}" for name, value in given.items()), **at)
    console.go_on(at["monotonic_s"])
    return []


def _catch_up(console: Console, raw: Raw, at: Raw) -> list[Message]:
    ledger = console.ledger
    newest = ledger.rows(INBOX_CAUGHT_UP)
    read = [row[0] for row in newest if row[0] in ledger.read_s]
    acts = {"acts": list(console.recent_acts.acts)} if at["by"] == CONDUCTOR else {}
    more = {"counts": ledger.counts(INBOX_CAUGHT_UP), "history": list(console.history), **acts}
    return [made("catch_up", to=at["page"], inbox=newest, read=read, **more)]


INTENTS: Mapping[str, Callable[[Console, Raw, Raw], list[Message]]] = {
    "command": _command,
    "pace": _pace,
    "veto": _veto,
    "judge": _judge,
    "read": _read,
    "held": _held,
    "isa": _answer,
    "tlx": _answer,
    "form": _answer,
    "ready": _ready,
    "note": _note,
    "help": _help,
    "end": _end,
    "page": _page,
    "beat": _beat,
    "sheet": _sheet,
    "catch_up": _catch_up,
}
