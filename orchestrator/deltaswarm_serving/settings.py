"""The table `[serve]` of a session's file: how participants come by link, and where they go from there."""

import os
from dataclasses import dataclass
from datetime import datetime

from deltaswarm_orchestrator.scenarios.load import read_toml
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, key

CODE = "{code}"

PER_CORE = 120.0
"""Sessions times (1 + speed) that a core carries, as measured at speed 5 (docs/BY_LINK.md)."""


@dataclass(frozen=True)
class ServeSettings:
    outside_id: str = key("", "parameter of the open link with an id from elsewhere, such as PROLIFIC_PID")
    return_url: str = key("", "where a person goes at the end; {code} stands for the completion code")
    at_once: int = key(0, "sessions at the same time; 0: as many as this machine carries", low=0, high=10_000)
    absent_after_s: float = key(
        600.0, "a place is free again once nobody was at its page for this long [wall s]", low=5.0, high=86_400.0
    )
    opens: str = key("", "when people may begin, in ISO 8601 with the offset, such as 2026-12-01T08:00+01:00")
    closes: str = key("", "when nobody new may begin any more, likewise; who has begun goes on")
    per_address: int = key(
        30, "new participants by the open link from one network address in an hour", low=1, high=100_000
    )

    def problems(self) -> list[Problem]:
        """Check the address at the end, and the times."""
        found = []
        if self.return_url and not self.return_url.startswith(("https://", "http://")):
            found.append(Problem("return_url", repr(self.return_url), "must begin with https:// or http://"))
        for name, told in (("opens", self.opens), ("closes", self.closes)):
            if told and not _is_moment(told):
                found.append(Problem(name, repr(told), "must be a moment with an offset: 2026-12-01T08:00+01:00"))
        return found

    def places(self, speed: float, *, by_processes: bool = False) -> int:
        """Return how many sessions may be under way; `speed` [simulated s / wall s], 0: as fast as possible."""
        if self.at_once:
            return self.at_once
        each = PER_CORE / (1.0 + speed) if speed and not by_processes else 1.0
        return max(1, int((os.cpu_count() or 1) * each))


def _is_moment(text: str) -> bool:
    try:
        return datetime.fromisoformat(text).tzinfo is not None
    except ValueError:
        return False


def load_serve(file: str) -> ServeSettings:
    """Load the table from a session's file; without it, all is as by default.

    Raises:
        SettingsError: it has mistakes.
    """
    table, _ = read_toml("serve", file, {})
    return checked.load(ServeSettings, table.get("serve", {}), "serve")
