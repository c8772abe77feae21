"""Draw a figure of a study, whatever its kind."""

from importlib import import_module
from typing import NamedTuple, Protocol, cast

from matplotlib.figure import Figure

from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.kinds import KINDS
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.study import Study


class Drawing(NamedTuple):
    """A figure as drawn."""

    figure: Figure
    notes: tuple[str, ...] = ()
    """Sentences that its caption must have, such as how many values a median is of."""


class Draw(Protocol):
    """A function that draws figures of one kind."""

    def __call__(self, settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
        """Return the figure, and what its caption must say.

        Raises:
            ValueError: there is nothing to draw; the page and the command say so.
        """
        ...


def draw(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw a figure by the function of its kind.

    Raises:
        ValueError: there is nothing to draw.
    """
    module, _, name = KINDS[settings.kind].drawn_by.partition(":")
    function = cast(Draw, getattr(import_module(f"{__package__}.{module}"), name))
    return function(settings, study, evidence)
