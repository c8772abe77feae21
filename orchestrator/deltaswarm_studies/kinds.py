"""The kinds of figures that a study file may ask for: the keys that each needs and allows, and its drawing function.

A new kind is an entry of `KINDS`, and a function in a file of its own. Nothing here imports Matplotlib, so that a study
can be checked and planned without it.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """The keys of `[[figure]]` that a figure of one kind has."""

    about: str
    drawn_by: str
    """The function that draws it, a `Draw` of `drawing.py`, as `module:name` within this package."""
    metrics: tuple[str, ...] = ("metric",)
    """Keys that name metrics."""
    is_over_time: bool = False
    """Whether its metrics must have a time series; others have a number per run."""
    is_of_events: bool = False
    """Whether it is drawn from single events; its metrics must be means of times until a moment."""
    factors: tuple[str, ...] = ("hue", "facet")
    """Keys that name factors."""
    needs: tuple[str, ...] = ()
    """Keys without which there is nothing to draw."""
    heeds: tuple[str, ...] = ("variants", "lines")
    """Further keys; those that a figure of this kind would not show are refused."""

    @property
    def keys(self) -> set[str]:
        return {"name", "kind", "caption", *self.metrics, *self.factors, *self.needs, *self.heeds}


MOST_LOOKS = 12
"""Most colours, markers and lines that a reader can tell apart in one figure."""

ALONG = ("x", "hue", "facet")

KINDS: Mapping[str, Kind] = {
    "boxes": Kind(
        "quartiles and a point per replicate",
        "charts:boxes",
        factors=ALONG,
        needs=("x",),
        heeds=("variants", "lines", "published"),
    ),
    "levels": Kind("medians along a factor", "charts:levels", factors=ALONG, needs=("x",)),
    "time": Kind("means over windows", "charts:time", is_over_time=True, heeds=("variants", "lines", "spans")),
    "plane": Kind(
        "two metrics, a point per replicate",
        "planes:plane",
        metrics=("metric", "x"),
        needs=("x", "hue"),
        heeds=("variants", "lines", "path"),
    ),
    "frontier": Kind(
        "medians of two metrics", "planes:frontier", metrics=("metric", "x"), factors=("facet",), needs=("x", "paths")
    ),
    "survival": Kind(
        "the share of events that still wait, by Kaplan and Meier",
        "event_page:survival",
        is_of_events=True,
        heeds=("variants", "horizon_s"),
    ),
    "rings": Kind(
        "times by distance from the densest place",
        "event_page:rings",
        is_of_events=True,
        heeds=("variants", "horizon_s", "rings"),
    ),
    "swarm": Kind(
        "agents and events at a moment", "charts:swarms", metrics=(), factors=(), heeds=("variants", "at_s", "seed")
    ),
}
