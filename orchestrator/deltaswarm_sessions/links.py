"""Links of participants: whose they are and how far each has come. A link is made by the experimenter or on arrival.

Pure, but for reading and writing the file of them, which only its owner can read: it has tokens and outside ids.
"""

import json
import secrets
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Self

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.files import write_whole

FILE = "links.json"
"""In the folder of all sessions."""

TOKEN_BYTES = 18
"""24 characters in a URL."""

NEW, WAITING, RUNNING, AWAY = "new", "waiting", "running", "away"
COMPLETE, SCREENED_OUT, DECLINED, ENDED, FAILED = "complete", "screened out", "declined", "ended", "failed"
OVER = (COMPLETE, SCREENED_OUT, DECLINED, ENDED)
"""States that do not change any more. Who failed may try again: the session goes on where it was."""


@dataclass
class Link:
    token: str
    number: int | None = None
    """The participant's; None: given once the session begins."""
    state: str = NEW
    outside: str = ""
    """The id that another service knows the person by."""
    agreed: str = ""
    """When the person agreed to take part; empty: not yet."""
    begun: str = ""
    """When the session began."""
    note: str = ""
    """The experimenter's."""


@dataclass
class Links:
    """All links of a study.

    Attributes:
        secret: what completion codes are made with.
        join: the token of the open link, which gives each new person a link of its own.
        overview: the token of the experimenter's page.
    """

    secret: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    join: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))
    overview: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))
    links: list[Link] = field(default_factory=list)

    def by_token(self, token: str) -> Link | None:
        """Return the link with a token, in the same time whichever it is."""
        given = token.encode(errors="replace")
        found = [link for link in self.links if secrets.compare_digest(link.token.encode(), given)]
        return found[0] if found else None

    def watchers(self, link: Link) -> str:
        """Return the token of the page that shows what a participant sees, and from which nothing else follows."""
        return sha256(f"{self.secret} {link.token}".encode()).hexdigest()[: TOKEN_BYTES * 2]

    def by_watchers(self, token: str) -> Link | None:
        given = token.encode(errors="replace")
        found = [link for link in self.links if secrets.compare_digest(self.watchers(link).encode(), given)]
        return found[0] if found else None

    def of_outside(self, outside: str) -> Link | None:
        return next((link for link in self.links if outside and link.outside == outside), None)

    def add(self, number: int | None = None, outside: str = "") -> Link:
        link = Link(secrets.token_urlsafe(TOKEN_BYTES), number, outside=outside)
        self.links.append(link)
        return link

    @property
    def numbers(self) -> set[int]:
        """Numbers that are given to a link."""
        return {link.number for link in self.links if link.number is not None}

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the links of a folder of sessions; new ones if there is no file.

        Raises:
            CommandError: the file is not as `write` wrote it.
        """
        file = folder / FILE
        if not file.exists():
            return cls()
        try:
            content = json.loads(file.read_text(encoding="utf-8"))
            return cls(**{**content, "links": [Link(**link) for link in content["links"]]})
        except (ValueError, TypeError, KeyError) as error:
            raise CommandError(f"{file} must be as `deltaswarm serve` wrote it ({error}); restore it") from None

    def write(self, folder: Path) -> None:
        write_whole(folder / FILE, json.dumps(asdict(self), indent=1).encode() + b"\n", 0o600)


def table(links: Iterable[Link], base: str) -> list[dict[str, str]]:
    """Return rows of links to hand out."""
    return [
        {"number": f"{link.number or ''}", "state": link.state, "address": f"{base}p/{link.token}/"} for link in links
    ]
