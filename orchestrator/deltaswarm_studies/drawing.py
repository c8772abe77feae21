"""Draw a figure of a study, whatever its kind."""

from collections.abc import Callable
from importlib import import_module
from typing import NamedTuple, cast

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


Draw = Callable[[FigureSettings, Study, Evidence], Drawing]
"""Draws figures of one kind; raises ValueError, which the page and the command show, if there is nothing to draw."""


def draw(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    module, _, name = KINDS[settings.kind].drawn_by.partition(":")
    return cast(Draw, getattr(import_module(f"{__package__}.{module}"), name))(settings, study, evidence)
