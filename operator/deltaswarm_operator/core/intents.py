"""What somebody at the station wants: orders, pace, items read, answers, notes; checked, then done at the console.

Pure: the page's messages in, answers out. `docs/STATION.md` lists the messages.
"""

import json
from collections.abc import Callable, Mapping
from hashlib import sha256
from typing import Any

from deltaswarm_operator.core.console import INBOX_CAUGHT_UP, Console, compact
from deltaswarm_operator.core.picture import item_rows
from deltaswarm_operator.core.probes import FORM
from deltaswarm_scenario.operator_settings import ISA, TLX
from deltaswarm_scenario.person_tables import CONDUCTOR, PERSON
from deltaswarm_scenario.task import CLASSES
from deltaswarm_wire.commands import make_target, named

MAX_NOTE, MAX_PAGE_TEXT, MAX_CODE = 2000, 200, 64
"""Characters."""

NO_CONSENT = "the run begins once the participant has consented"
TARGET_FIELDS = {
    "circle": ("x_m", "y_m", "radius_m"),
    "tree": ("root",),
    "agent": ("agent",),
    "place": ("x_m", "y_m"),
}
CONDUCTS = frozenset({"pace", "note", "catch_up"})
"""What the conductor of an experiment may do; only the participant commands and answers."""

Raw = Mapping[str, Any]


def carry_out(console: Console, data: bytes, wall_s: float, by: str = PERSON) -> list[bytes]:
    """Carry out an intent of the participant or the conductor, if it is one; return the answers.

    An answer without `to` is for every page.
    """
    try:
        raw = json.loads(data)
    except ValueError:
        raw = None
    kind = raw.get("type") if isinstance(raw, dict) else None
    act = INTENTS.get(kind) if isinstance(kind, str) else None
    if act is None or (by == CONDUCTOR and kind == "page"):
        return []
    page = raw.get("from")
    at = {"by": by, "monotonic_s": wall_s, "page": page if type(page) is int else None}
    try:
        if by == CONDUCTOR and kind not in CONDUCTS:
            raise ValueError("the conductor may pause and write notes; the participant does all else")
        return [compact(**answer) for answer in act(console, raw, at)]
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        why = str(error) if isinstance(error, ValueError) else f"{kind}: something is missing or wrong"
        return [compact(to=page, type="refused", id=str(raw.get("id", kind))[:MAX_CODE], why=why)]


def _command(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    if console.probes.is_sheet_open:
        raise ValueError(NO_CONSENT)
    target, offered = raw["target"], console.briefing.offered
    form = named(offered, raw["name"])
    if form is None:
        names = ", ".join(form.name for form in offered)
        raise ValueError(f"the order must be one that this run offers: {names or 'none'}")
    if console.is_refused(form):
        raise ValueError(f"no agent carries out {form.name} in this run")
    numbers = [target[field] for field in TARGET_FIELDS.get(target["kind"], ())]
    aim = make_target([target["kind"], *numbers])
    number = console.command(name=raw["name"], target=aim, arguments=raw.get("arguments", {}), **at)
    return [{"type": "accepted", "to": at["page"], "id": str(raw.get("id", ""))[:MAX_CODE], "number": number}]


def _pace(console: Console, raw: Raw, at: Raw) -> list[Raw]:
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
        if not 0.0 <= value <= 1000.0:
            raise ValueError(f"the speed must be from 0 to 1000 (got {value:.15g})")
        pace = console.pace._replace(speed=value)
    elif "steps" in raw:
        name, steps = "step", int(raw["steps"])
        if not 1 <= steps <= 10_000:
            raise ValueError(f"the number of steps must be from 1 to 10,000 (got {steps})")
        value = float(steps)
        ends = (console.step + 1 + steps, console.next_hold_step)
        pace = console.pace._replace(hold_step=min(end for end in ends if end >= 0))
    else:
        name = "pause" if raw["paused"] else "resume"
        pace = console.pace._replace(hold_step=console.step + 1 if raw["paused"] else console.next_hold_step)
    console.set_pace(pace, at["monotonic_s"])
    console.note(kind="pace", name=name, value=value, **at)
    return []


def _veto(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    if console.autonomy is None:
        raise ValueError("in this run the system does not set delta")
    console.note(kind="veto", value=console.autonomy.veto(), **at)
    return []


def _judge(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    if not console.briefing.operator.task.is_on:
        raise ValueError("in this run events are not judged")
    event, answer = raw["event"], raw["answer"]
    if answer not in CLASSES:
        raise ValueError(f"the answer must be {' or '.join(CLASSES)} (got {answer!r})")
    if event not in console.picture.events:
        raise ValueError(f"event {event} must be one that is reported now")
    console.judgements[event] = answer
    console.note(kind="judge", name=answer, event=event, **at)
    return []


def _read(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    picture = console.picture
    numbers = list(picture.unread) if raw.get("all") else [int(number) for number in raw["items"]]
    fresh = picture.read(numbers)
    if fresh:
        if console.attention is not None:
            console.attention.read(picture, fresh, at["monotonic_s"])
        console.note(kind="read", items=" ".join(map(str, fresh)), **at)
    return [{"type": "read", "items": fresh}]


def _isa(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    console.probes.answer_isa(raw["number"], raw["answer"], at["monotonic_s"])
    console.note(kind=ISA, value=raw["answer"], **at)
    return []


def _tlx(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    console.probes.answer_tlx(raw["scales"], raw.get("weights"), at["monotonic_s"])
    console.note(kind=TLX, **at)
    return []


def _form(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    console.probes.answer_form(raw["form"], raw["answers"], at["monotonic_s"])
    console.note(kind=FORM, name=raw["form"], **at)
    console.go_on(at["monotonic_s"])
    return []


def _note(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    console.note(kind="note", text=str(raw["text"])[:MAX_NOTE], **at)
    return []


def _page(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    name, text = str(raw["event"])[:MAX_PAGE_TEXT], str(raw.get("text", ""))[:MAX_PAGE_TEXT]
    console.note(kind="page", name=name, text=text, **at)
    return []


def _sheet(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    if raw.get("consent") is not True:
        raise ValueError(NO_CONSENT)
    probes = console.briefing.operator.probes
    given = {name: str(raw.get(name, ""))[:MAX_CODE] for name in ("participant", "condition")}
    for name, value in given.items():
        if (planned := getattr(probes, name)) and value != planned:
            raise ValueError(f"the {name} must be {planned}, as planned (got {value!r})")
    console.probes.take_sheet(at["monotonic_s"])
    if probes.consent:
        shown = console.briefing.operator.page.language.of(probes.consent)
        given["consent_sha256"] = sha256(shown.encode()).hexdigest()
    console.note(kind="sheet", text="; ".join(f"{name}={value}" for name, value in given.items()), **at)
    console.go_on(at["monotonic_s"])
    return []


def _catch_up(console: Console, raw: Raw, at: Raw) -> list[Raw]:
    newest = console.picture.inbox[-INBOX_CAUGHT_UP:]
    read = [item.number for item in newest if item.number not in console.picture.unread]
    history = list(console.history)
    answer = {"type": "catch_up", "to": at["page"], "inbox": item_rows(newest), "read": read, "history": history}
    return [{**answer, "acts": list(console.mirror.acts)} if at["by"] == CONDUCTOR else answer]


INTENTS: Mapping[str, Callable[[Console, Raw, Raw], list[Raw]]] = {
    "command": _command,
    "pace": _pace,
    "veto": _veto,
    "judge": _judge,
    "read": _read,
    "isa": _isa,
    "tlx": _tlx,
    "form": _form,
    "note": _note,
    "page": _page,
    "sheet": _sheet,
    "catch_up": _catch_up,
}
"""What is done for each type of message."""
