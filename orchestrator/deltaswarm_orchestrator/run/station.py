"""The station of a run: what the operator is told for it, the socket pair between the two, where its page is."""

import json
import os
import secrets
import socket
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path

import tomli_w

from deltaswarm_wire import checked
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.plugins import find_controller
from deltaswarm_wire.settings import Scenario

STATION = "station"
"""The role of the station's process."""

BRIEFING, ADDRESS = "operator.toml", "station.json"
LOOPBACK = "127.0.0.1:0"


@dataclass(eq=False)
class Station:
    """What the user wants of the station, and the two ends of its channel.

    The operator's stays open here, so that it can be started again. `speed`: simulated per wall second, 0 as fast as
    the machine goes. `listen`: HOST:PORT of the page.
    """

    speed: float = 1.0
    listen: str = LOOPBACK
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """The secret part of the page's URL."""
    operators_end: socket.socket = field(init=False)
    stations_end: socket.socket = field(init=False)

    def __post_init__(self) -> None:
        self.operators_end, self.stations_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def close(self) -> None:
        """Close both ends."""
        self.operators_end.close()
        self.stations_end.close()


def write_briefing(folder: Path, scenario: Scenario, station: Station | None) -> Path:
    """What the operator is told of a scenario, as a file in the run folder."""
    forms = forms_of(find_controller(scenario.control.mode))
    briefing = scenario.for_operator(forms, station.speed if station else 0.0)
    file = folder / BRIEFING
    file.write_text(tomli_w.dumps(checked.plain(briefing)))
    return file


def announce(folder: Path, url: str) -> None:
    """Leave the page's address in the run folder, for this user alone, and open it where there is a browser."""
    file = folder / ADDRESS
    file.touch(mode=0o600)
    file.write_text(json.dumps({"url": url}) + "\n")
    open_browser(url)


def open_browser(url: str) -> None:
    """Open a page where there is a browser with a window; one in the terminal would take it over."""
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)


def address(folder: Path) -> str | None:
    """The page of a run's station; None where the run has none."""
    file = folder / ADDRESS
    return str(json.loads(file.read_text())["url"]) if file.exists() else None
