"""Draw the effects of a run's orders: a panel per measure, a line per order with its interval."""

from collections.abc import Sequence
from pathlib import Path

from deltaswarm_branches.effects import UNDECIDED, OrderEffect
from deltaswarm_branches.pairs import BY_KEY, MEASURES
from deltaswarm_studies.style import MODES, drawing, laid_out, new_figure, save

COLOUR = MODES["hybrid"].colour
WIDTH_IN, LINE_IN, FRAME_IN = 4.8, 0.16, 0.9
MAX_LINES = 60
"""Orders beyond these are in the table only."""


def draw(rows: Sequence[OrderEffect], path: Path) -> list[Path]:
    """Draw the orders from the first down, filled where a difference is decided; write the files of the figure."""
    orders = list({row.order.number: row.order for row in rows}.values())[:MAX_LINES]
    with drawing():
        figure = new_figure(WIDTH_IN, FRAME_IN + LINE_IN * max(3, len(orders)))
        panels = figure.subplots(1, len(MEASURES), sharey=True)
        for panel, (name, key) in zip(panels, MEASURES.items(), strict=True):
            panel.axvline(0.0, color="0.6", linewidth=0.6)
            for place, order in enumerate(orders):
                effect = next(row.effect for row in rows if row.order == order and row.effect.measure == name)
                middle = effect.value if effect.estimate is None else effect.estimate
                if middle is None:
                    continue
                if effect.low is not None and effect.high is not None:
                    panel.plot([effect.low, effect.high], [place, place], color=COLOUR, linewidth=1.0)
                filled = COLOUR if effect.verdict != UNDECIDED and effect.estimate is not None else "white"
                panel.plot([middle], [place], "o", color=COLOUR, markerfacecolor=filled, markersize=3.5)
            unit = BY_KEY[key].unit
            panel.set_xlabel(f"{name} [{unit}]" if unit else name)
            panel.locator_params(axis="x", nbins=3)
        panels[0].set_yticks(range(len(orders)), [f"{order.number} {order.command.name}" for order in orders])
        panels[0].invert_yaxis()
        return save(laid_out(figure), path)
