"""What the figures of a run's summary are called, their units, and what more and less of each is."""

from dataclasses import dataclass

from deltaswarm_orchestrator.analysis.report import Column


@dataclass(frozen=True)
class FigureName:
    """A figure's name for people."""

    title: str
    unit: str = ""
    more: str = "higher"
    less: str = "lower"

    @property
    def label(self) -> str:
        """For an axis: title and unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    def column(self) -> Column:
        """For a table of several figures."""
        return Column(self.title, self.unit)


FIGURES = {
    "waiting_time_s.mean": FigureName("Mean waiting time", "s", "longer", "shorter"),
    "waiting_time_s.mean_with_never_sensed": FigureName(
        "Mean waiting time, events never sensed counted to the end", "s", "longer", "shorter"
    ),
    "operator_messages_per_s.mean": FigureName("Messages to the operator", "1/s", "more", "fewer"),
    "frames_sent_per_s.mean": FigureName("Radio frames sent", "1/s", "more", "fewer"),
    "agents_in_trees.mean": FigureName("Agents in trees", "", "more", "fewer"),
    "trees.mean": FigureName("Trees", "", "more", "fewer"),
    "covered_area_m2.mean": FigureName("Covered area", "m²", "larger", "smaller"),
}
"""The main figures, in a report's order."""

_UNITS = {"_per_s": "1/s", "_m2": "m²", "_mb": "MB", "_s": "s", "_m": "m"}


def named(figure: str) -> FigureName:
    """A figure's name; of one that is not among the main ones, from the table's own name for it."""
    if figure in FIGURES:
        return FIGURES[figure]
    first, *rest = figure.split(".")
    for suffix, unit in _UNITS.items():
        if first.endswith(suffix):
            return FigureName(_words(first.removesuffix(suffix), rest), unit)
    return FigureName(_words(first, rest))


def _words(first: str, rest: list[str]) -> str:
    text = " ".join([first.replace("_", " ").capitalize(), *(part.replace("_", " ") for part in rest)])
    return text.removesuffix(" mean") if rest == ["mean"] else text
