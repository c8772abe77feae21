"""The station of a run: the operator's briefing, the socket pair between operator and station, the page's address."""

import json
import os
import secrets
import socket
import webbrowser
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import tomli_w

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.files import write_whole
from deltaswarm_wire.plugins import find_controller
from deltaswarm_wire.session import free_port

STATION = "station"
"""The role of the station's process."""

BRIEFING, ADDRESS = "operator.toml", "station.json"
LOOPBACK = "127.0.0.1:0"


@dataclass(eq=False)
class StationChannel:
    """The station's settings, and the two ends of its channel to the operator.

    The operator's end stays open here, so that the operator can be restarted. `speed`: simulated per wall second; 0: as
    fast as possible. `listen`: HOST:PORT of the page. `markers`: HOST:PORT or "lsl", where the person's acts are told.
    """

    speed: float = 1.0
    listen: str = LOOPBACK
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """The secret part of the page's URL."""
    markers: str = ""
    is_elsewhere: bool = False
    """Whether the page is served by whoever has the station's end, and not by a process of the run."""
    opens_browser: bool = True
    """Whether to open the page in a browser, if there is a display."""
    watch_url: str = field(default="", init=False)
    """The page of those who only watch, once it is up."""
    operators_end: socket.socket = field(init=False)
    stations_end: socket.socket = field(init=False)

    def __post_init__(self) -> None:
        self.operators_end, self.stations_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def close(self) -> None:
        self.operators_end.close()
        self.stations_end.close()


def free_address(listen: str) -> str:
    """Return HOST:PORT with a free port in place of port 0, at which one station after another can listen."""
    host, _, port = listen.rpartition(":")
    if int(port):
        return listen
    try:
        return f"{host}:{free_port(host.strip('[]'))}"
    except OSError:  # the station itself says what is wrong with the address
        return listen


def write_briefing(folder: Path, scenario: Scenario, station: StationChannel | None) -> Path:
    """Write what the operator may know of a scenario into the run folder; return the file."""
    forms = forms_of(find_controller(scenario.control.mode))
    briefing = scenario.for_operator(forms, station.speed if station else 0.0)
    file = folder / BRIEFING
    write_whole(file, tomli_w.dumps(checked.plain(briefing)).encode())
    return file


def announce(folder: Path, urls: Mapping[str, str], *, opens_browser: bool) -> None:
    """Write the pages' addresses into the run folder, readable by this user alone; maybe open `url` in a browser."""
    write_whole(folder / ADDRESS, json.dumps(urls).encode() + b"\n", 0o600)
    if opens_browser:
        open_browser(urls["url"])


def open_browser(url: str) -> None:
    """Open a page in a graphical browser, if there is a display; a text browser would take over the terminal."""
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)


def address(folder: Path) -> str | None:
    """Return the URL of a run's station page; None if the run has none."""
    file = folder / ADDRESS
    return str(json.loads(file.read_text(encoding="utf-8"))["url"]) if file.exists() else None
