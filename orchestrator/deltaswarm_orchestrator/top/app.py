"""The terminal's screen: map, message rate, agents and events, drawn four times per second."""

from collections import deque
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Footer, Sparkline, Static, TabbedContent, TabPane

from deltaswarm_orchestrator.top.drawing import LEGEND, Letters, agents_table, draw_map, events_table, summary
from deltaswarm_orchestrator.top.link import Link

DRAW_EVERY_S = 0.25
RATES_KEPT = 120
"""Number of message rates kept for the chart: half a minute."""

BANNER = "Researcher's view: shows what no operator knows"
NO_TRUTH = (
    "This run is not recorded, so it has no map. Start it with --record views, or with --live foxglove, to see one."
)


class Top(App[None]):
    """The application that shows one run; after the run's end it keeps the last picture until the user quits."""

    CSS = """
    #banner { background: $warning; color: $text; width: 100%; height: 1; text-align: center; }
    #map { width: 1fr; height: 1fr; }
    #side { width: 46; padding: 0 1; }
    #rates { height: 3; margin: 1 0; }
    #summary { height: auto; }
    #legend { height: 1; }
    TabPane { padding: 0; }
    """
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = [
        ("q", "quit", "Quit"),
        ("a", "show('agents')", "Agents"),
        ("e", "show('events')", "Events"),
    ]

    def __init__(self, link: Link) -> None:
        super().__init__()
        self._link = link
        self._letters = Letters()
        self._rates_hz: deque[float] = deque(maxlen=RATES_KEPT)

    def compose(self) -> ComposeResult:
        yield Static(BANNER, id="banner", markup=False)
        with Horizontal():
            yield Static("waiting for the run", id="map", markup=False)
            with Vertical(id="side"):
                yield Static("", id="summary", markup=False)
                yield Sparkline([], id="rates")
                with TabbedContent(initial="agents"):
                    with TabPane("Agents", id="agents"), VerticalScroll():
                        yield Static("", id="agents-table", markup=False)
                    with TabPane("Events", id="events"), VerticalScroll():
                        yield Static("", id="events-table", markup=False)
        yield Static(LEGEND, id="legend", markup=False)
        yield Footer()

    def on_mount(self) -> None:
        self.set_interval(DRAW_EVERY_S, self.draw)
        self.draw()

    def on_resize(self) -> None:
        """Redraw for the new size at once."""
        self.call_after_refresh(self._draw_picture)

    def action_show(self, tab: str) -> None:
        self.query_one(TabbedContent).active = tab

    def draw(self) -> None:
        """Receive what has arrived, and show the newest picture."""
        if self._link.is_over:
            return
        if self._link.receive():
            self._rates_hz.append(self._link.picture["workload"]["rate_1s_hz"])
            self._draw_picture()
        if self._link.is_over:
            self._static("banner").update(f"{BANNER} - the run has ended")

    def _draw_picture(self) -> None:
        hello, picture = self._link.hello, self._link.picture
        if not picture:
            return
        truth = picture["truth"]
        self.title = hello["title"]
        self._static("summary").update(f"{hello['run']}\n{hello['title']}\n\n{summary(hello, picture)}")
        self.query_one("#rates", Sparkline).data = list(self._rates_hz)
        place = self._static("map")
        if truth is None:
            place.update(NO_TRUTH)
            return
        letters = self._letters.of(row[5] for row in truth["agents"])
        place.update(draw_map(hello, truth, letters, place.size.width, place.size.height))
        if self.query_one(TabbedContent).active == "agents":
            self._static("agents-table").update(agents_table(truth, letters))
        else:
            self._static("events-table").update(events_table(truth, picture["time_s"]))

    def on_tabbed_content_tab_activated(self) -> None:
        """Fill the tab that is now shown."""
        self._draw_picture()

    def _static(self, name: str) -> Static:
        return self.query_one(f"#{name}", Static)
