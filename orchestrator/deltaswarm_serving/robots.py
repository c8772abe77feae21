"""Scripted participants, for rehearsals: each opens the link as a browser does, takes part and answers at random.

They are people to the service: real connections, no other way in. What they answer means nothing.
"""

import asyncio
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from random import Random
from typing import Any
from urllib.parse import urljoin, urlsplit

import orjson
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin

from deltaswarm_scenario.questions import CHOICE, FORM, SHEET, TEXT
from deltaswarm_scenario.task import CLASSES
from deltaswarm_scenario.tlx import SCALES
from deltaswarm_serving.routes import DOOR, LIVE, RUN
from deltaswarm_sessions.links import FAILED, OVER

Message = dict[str, Any]

MAX_PICTURE_BYTES = 1 << 22
AGAIN_S = 1.0
BEAT_EVERY_S = 1.0
ACT_EVERY_S = 5.0
"""About how often a robot reads, judges or gives an order [wall s]."""


@dataclass
class Robot:
    """One scripted participant, who begins at the open link.

    Args:
        open_link: with the id from elsewhere, if there is one.
        chance: what it draws from.
    """

    open_link: str
    chance: Random
    code: str = ""
    _link: str = ""
    _answered: set[str] = field(default_factory=set)
    """Questions that were answered, with their runs."""
    _inputs: int = 0

    async def take_part(self) -> str:
        """Go through the whole session; return its state at the end."""
        while True:
            with suppress(ConnectionClosed, OSError, InvalidStatus):
                told = await self._at_door()
                if told["state"] in (*OVER, FAILED):
                    self.code = told.get("code", "")
                    return str(told["state"])
                await self._at_station()
            await asyncio.sleep(AGAIN_S)

    async def _at_door(self) -> Message:
        """Agree, wait for a place; return what the door says once something is to be done."""
        async with opened(self._link or self.open_link, DOOR) as door:
            async for text in door:
                told: Message = orjson.loads(text)
                if told["type"] == "go":
                    self._link = urljoin(self.open_link, told["address"])
                    return {"state": ""}
                if told.get("state") == "new":
                    await door.send('{"type":"agree"}')
                elif told.get("state") not in (None, "waiting", "away"):
                    return told
        raise OSError("the door was closed")

    async def _at_station(self) -> None:
        """Be at the page of the session under way, until it has moved."""
        if not self._link:
            return
        async with opened(f"{self._link}{RUN}/", LIVE) as page:
            hello: Message = {}
            loop = asyncio.get_running_loop()
            beat_s = act_s = 0.0
            async for text in page:
                message: Message = orjson.loads(text)
                if message["type"] == "moved":
                    return
                if message["type"] == "hello":
                    hello = message
                if message["type"] == "refused" and message.get("id") in ("sheet", "form", "tlx", "isa", "ready"):
                    self._answered.clear()  # another answer may do
                if message["type"] != "picture" or not hello:
                    continue
                probe, now_s = message.get("probe"), loop.time()
                is_done = bool(message["over"]) and probe is None
                if now_s >= beat_s or is_done:
                    beat_s = now_s + BEAT_EVERY_S
                    await page.send(json.dumps({"type": "beat", "rtt_s": 0.0, "done": is_done}))
                if probe is not None and (key := _key(hello, probe)) not in self._answered:
                    self._answered.add(key)
                    await self._put(page, answer(probe, hello, self.chance))
                elif probe is None and not is_done and now_s >= act_s:
                    act_s = now_s + self.chance.expovariate(1.0 / ACT_EVERY_S)
                    if (act := act_on(message, hello, self.chance)) is not None:
                        await self._put(page, act)

    async def _put(self, page: ClientConnection, act: Message) -> None:
        self._inputs += 1
        await page.send(json.dumps({**act, "id": f"robot-{self._inputs}"}))


def opened(page: str, name: str) -> connect:
    """Open a page's WebSocket, as the page does."""
    address = urlsplit(urljoin(page, name))
    live = address._replace(scheme="wss" if address.scheme == "https" else "ws", query=urlsplit(page).query)
    origin = Origin(f"{address.scheme}://{address.netloc}")
    return connect(live.geturl(), origin=origin, max_size=MAX_PICTURE_BYTES, close_timeout=1.0)


def answer(probe: Mapping[str, Any], hello: Mapping[str, Any], chance: Random) -> Message:
    """Return an answer to an open question, drawn at random from those that it takes."""
    kind = probe["kind"]
    if kind == SHEET:
        sheet = hello["session"]["sheet"]
        return {"type": SHEET, "consent": True, "participant": sheet["participant"], "condition": sheet["condition"]}
    if kind == FORM:
        about = {"form": probe["form"]["name"], "number": probe["number"]}
        if probe.get("prompt"):
            return {"type": "ready", **about}
        return {"type": FORM, **about, "answers": {q["name"]: _value(q, chance) for q in probe["form"]["question"]}}
    if kind == "tlx":
        chosen = [chance.choice(pair) for pair in probe.get("pairs", ())]
        weights = {"weights": {scale: chosen.count(scale) for scale in SCALES}} if chosen else {}
        return {"type": "tlx", "scales": {scale: chance.randrange(0, 101, 5) for scale in SCALES}, **weights}
    return {"type": "isa", "number": probe["number"], "answer": chance.randint(1, 5)}


def act_on(picture: Mapping[str, Any], hello: Mapping[str, Any], chance: Random) -> Message | None:
    """Return what a person may do now: read, judge, set delta; None: nothing."""
    judged = {event for event, _ in picture.get("judged", ())}
    open_events = [row[0] for row in picture["events"] if row[0] not in judged] if hello["goal"] else []
    acts: list[Callable[[], Message]] = []
    if picture["inbox"]:
        acts.append(lambda: {"type": "read", "items": [picture["inbox"][-1][0]]})
    if open_events:
        acts.append(lambda: {"type": "judge", "event": open_events[0], "answer": chance.choice(list(CLASSES))})
    if any(form["name"] == "set delta" and not form["refused"] for form in hello["commands"]):
        order = {"name": "set delta", "target": {"kind": "all"}, "arguments": {"delta": chance.randint(1, 6)}}
        acts.append(lambda: {"type": "command", **order})
    return chance.choice(acts)() if acts else None


def _value(question: Mapping[str, Any], chance: Random) -> Any:
    if question["kind"] == CHOICE:
        return chance.choice(question["choices"])
    if question["kind"] == TEXT:
        return "words of a robot"
    return chance.randint(int(question["low"]), int(question["high"]))


def _key(hello: Mapping[str, Any], probe: Mapping[str, Any]) -> str:
    """Return what tells a question from the others; the same form is asked again with a number of its own."""
    form = probe["form"]["name"] if probe["kind"] == FORM else ""
    return f"{hello['run']} {probe['kind']} {form} {probe.get('number')} {bool(probe.get('prompt'))}"
