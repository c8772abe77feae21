"""A study by link: who may begin, whose session is started, how it ends. The sockets are `front`'s."""

import asyncio
import logging
import shutil
import time
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import INTERRUPTED, CommandError
from deltaswarm_serving.hosted import SCREENED
from deltaswarm_serving.hosting import MOVED, Hosted, Plan
from deltaswarm_serving.line import Limiter, Line
from deltaswarm_serving.settings import CODE, ServeSettings
from deltaswarm_sessions import roster
from deltaswarm_sessions.codes import code_of
from deltaswarm_sessions.links import (
    AWAY,
    COMPLETE,
    DECLINED,
    ENDED,
    FAILED,
    NEW,
    OVER,
    RUNNING,
    SCREENED_OUT,
    WAITING,
    Link,
    Links,
)
from deltaswarm_sessions.plan import places_of
from deltaswarm_sessions.settings import SessionSettings

log = logging.getLogger("deltaswarm.serve")

RESTARTS, RESTARTS_WITHIN_S = 5, 600.0
"""A session that is killed more often than this in a span of time is not started again by itself."""

HOUR_S = 3600.0

PAUSED, EARLY, LATE, NO_ROOM = "paused", "early", "late", "no room"
"""Why nobody new may begin: the experimenter says so, it is too early or too late, the disk is almost full."""

LEAST_FREE_BYTES = 1 << 30
"""With less room on the disk nobody new is admitted; a session needs a few MB."""


@dataclass(eq=False)
class Study:
    session: SessionSettings
    settings: ServeSettings
    plan: Plan
    links: Links
    line: Line
    admits: bool = True
    """Whether the experimenter lets new people begin."""
    has_doors: bool = True
    """Whether people come by links that are kept; else the page of the only session is all there is."""
    hosted: dict[str, Hosted] = field(default_factory=dict)
    """By the token of the link; kept after the end, for pages that come back."""
    _codes: dict[str, str] = field(default_factory=dict, init=False)
    """Codes of sessions that are over, by the token of the link: for one, all files of its data are read."""
    _joins: Limiter = field(init=False)
    _restarts: Limiter = field(default_factory=lambda: Limiter(RESTARTS, RESTARTS_WITHIN_S), init=False)

    def __post_init__(self) -> None:
        self._joins = Limiter(self.settings.per_address, HOUR_S)
        for link in self.links.links:
            if link.state in (RUNNING, WAITING):  # of a service that was killed
                link.state = AWAY

    def host(self, link: Link) -> Hosted:
        return self.hosted.setdefault(link.token, Hosted(link))

    def join(self, outside: str, address: str) -> Link | None:
        """Return the link of a new person, or of one who is known by the id; None: too many from one address."""
        if link := self.links.of_outside(outside):
            return link
        if not self._joins.allows(address, time.monotonic()):
            return None
        link = self.links.add(outside=outside)
        self.save()
        return link

    def agree(self, link: Link) -> None:
        """Take note that a person agrees to take part, or comes back, and let them stand in line."""
        if link.state in OVER or link.state == RUNNING:
            return
        link.agreed = link.agreed or provenance.now()
        link.state = WAITING
        self.line.ask(link.token)
        self.save()

    def why_closed(self) -> str:
        """Return why nobody new may begin, as `told` says it; empty: people may."""
        if not self.has_doors:
            return ""
        if not self.admits:
            return PAUSED
        now = datetime.now(UTC)
        if self.settings.opens and now < datetime.fromisoformat(self.settings.opens):
            return EARLY
        if self.settings.closes and now >= datetime.fromisoformat(self.settings.closes):
            return LATE
        return NO_ROOM if self.free_bytes < LEAST_FREE_BYTES else ""

    @property
    def free_bytes(self) -> int:
        return shutil.disk_usage(self.plan.out).free

    def decline(self, link: Link) -> None:
        if link.state == NEW:
            link.state = DECLINED
            self.line.leave(link.token)
            self.save()

    async def admit(self, there: Collection[str]) -> None:
        """Start the sessions of those whose turn it is, and free the places of those who are away."""
        there = there if self.has_doors else [link.token for link in self.links.links]
        now_s = time.monotonic()
        for hosted in self.hosted.values():
            is_under_way = hosted.process is not None and not hosted.is_let_go
            if is_under_way and hosted.absent_s(now_s) > self.settings.absent_after_s:
                log.info("participant %s is away", hosted.link.number)
                hosted.let_go()
        self.line.is_open = self.why_closed() == ""
        for token in self.line.admit(there, {link.token for link in self.links.links if link.begun}):
            if link := self.links.by_token(token):
                await self._start(link)

    async def _start(self, link: Link) -> None:
        hosted = self.host(link)
        try:
            if link.number is None:
                link.number = await asyncio.to_thread(self._allocate)
            self.save()  # before the process: its number is used
            hosted.seen_s = time.monotonic()
            await hosted.start(self.plan, self._ended)
            if link.state == ENDED:  # meanwhile, by the experimenter
                hosted.let_go()
            else:
                link.state, link.begun = RUNNING, link.begun or provenance.now()
        except (OSError, CommandError) as error:
            log.error("the session of participant %s cannot start: %s", link.number, error)
            link.state = FAILED
            self.line.leave(link.token)
        self.save()

    def _allocate(self) -> int:
        """Give the next number, which keeps orders balanced."""
        with roster.held(self.plan.out):
            number: int = roster.next_number(self.session, self.plan.out, self.links.numbers, self.plan.share)["next"]
            roster.note_begun(self.plan.out, number)
        return number

    def _ended(self, hosted: Hosted, code: int) -> None:
        link = hosted.link
        self.line.leave(link.token)
        if link.state == ENDED:  # by the experimenter
            pass
        elif code in (0, SCREENED):
            link.state = COMPLETE if code == 0 else SCREENED_OUT
        elif hosted.is_let_go:
            link.state = AWAY
        elif code == INTERRUPTED:
            link.state = ENDED
        elif code < 0 and self._restarts.allows(link.token, time.monotonic()):  # killed: it can go on
            log.warning("the session of participant %s was killed (%d); it goes on", link.number, code)
            link.state = WAITING
            self.line.waiting.insert(0, link.token)
        else:
            log.error("the session of participant %s failed; see %s", link.number, self.plan.logs)
            link.state = FAILED
        if self.has_doors:
            hosted.pages.tell(MOVED)
        elif link.state in OVER:
            hosted.pages.end()
        self.save()

    def end(self, number: int) -> None:
        """End a participant's session, which then is not complete."""
        for link in self.links.links:
            if link.number == number and link.state not in OVER:
                link.state = ENDED
                self.line.leave(link.token)
                self.host(link).let_go()
        self.save()

    def note(self, number: int, text: str) -> None:
        for link in self.links.links:
            if link.number == number:
                link.note = text
        self.save()

    def code(self, link: Link) -> str:
        if link.state not in OVER or not self.has_doors:
            return ""
        if link.token not in self._codes:
            self._codes[link.token] = code_of(self.links, link, self.plan.out)
        return self._codes[link.token]

    def told(self, link: Link, there: Collection[str]) -> dict[str, Any]:
        """Return what the door's page is told of a link."""
        code = self.code(link)
        return {
            "state": link.state,
            "has_agreed": bool(link.agreed),
            "place": self.line.place(link.token, there),
            "closed": "" if link.begun else self.why_closed(),
            "opens": self.settings.opens,
            "code": code,
            "back": self.settings.return_url.replace(CODE, code) if code else "",
        }

    def rows(self) -> list[dict[str, Any]]:
        """Return what the experimenter sees of each participant."""
        now_s = time.monotonic()
        rows = []
        for link in self.links.links:
            hosted = self.hosted.get(link.token)
            shown = hosted.pages.shown if hosted and hosted.process else {}
            away_s = hosted.absent_s(now_s) if hosted and hosted.process else 0.0
            rows.append(
                {
                    "number": link.number,
                    "state": link.state,
                    "begun": link.begun,
                    "run": shown.get("run", ""),
                    "time_s": shown.get("time_s", 0.0),
                    "duration_s": shown.get("duration_s", 0.0),
                    "help": shown.get("help", ""),
                    "away_s": round(away_s, 1),
                    "note": link.note,
                    "watch": self.links.watchers(link),
                }
            )
        return rows

    def cells(self) -> dict[str, int]:
        """Return how many sessions are complete or under way, by the order of their conditions."""
        numbers = [link.number for link in self.links.links if link.number and link.state in (RUNNING, COMPLETE)]
        return Counter(" > ".join(place.condition.label for place in places_of(self.session, n)) for n in numbers)

    def save(self) -> None:
        if self.has_doors:
            self.links.write(self.plan.out)
