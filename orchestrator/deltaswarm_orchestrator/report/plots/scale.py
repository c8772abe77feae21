"""Draw speed and memory of a run against the number of agents: the testbed's limits, not a figure of the paper."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from deltaswarm_orchestrator.report.plots import style
from deltaswarm_orchestrator.report.plots.density import Floats

PANELS = (("steps_per_s", "steps per s", -1), ("peak_memory_mb", "memory [MB]", 1))
"""Key, label, and exponent at linear cost: twice the agents make half the steps per second, or twice the memory."""

LINEAR = "linear in the number of agents"


def scale(rows: Sequence[Mapping[str, float]], *, width_in: float = style.TEXT_IN, height_in: float = 2.3) -> Figure:
    """Draw steps per second and memory against the number of agents, both axes logarithmic.

    The thin dashed line extrapolates from the smallest swarm, at a cost linear in the number of agents.

    Args:
        rows: one for each number of agents, with `agents`, `steps_per_s` and `peak_memory_mb`, all above 0.
        width_in: width [in].
        height_in: height [in].
    """
    ordered = sorted(rows, key=lambda row: row["agents"])
    agents = np.array([row["agents"] for row in ordered], dtype=np.float64)
    look = style.OTHERS[0]
    with style.drawing():
        figure = style.new_figure(width_in, height_in)
        for axes, (key, label, power) in zip(figure.subplots(1, 2), PANELS, strict=True):
            values = np.array([row[key] for row in ordered])
            linear = values[0] * (agents / agents[0]) ** power
            axes.plot(agents, linear, color=style.GREY, linewidth=0.7, linestyle=(0, (6, 3)), label=LINEAR)
            axes.plot(agents, values, color=look.colour, marker=look.marker, markersize=4, label="measured")
            _finish(axes, agents, label)
        figure.legend(handles=figure.axes[0].lines[:1], loc="outside upper center")
    return figure


def _finish(axes: Axes, agents: Floats, label: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(FixedLocator(_apart(agents)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_tick_params(which="minor", length=0)
    axes.set_xlabel("number of agents")
    axes.set_ylabel(label)
    axes.grid(True, color=style.PALE, linewidth=0.5)
    axes.set_axisbelow(True)


def _apart(counts: Floats) -> list[float]:
    """Select the counts that can be written below a logarithmic axis without touching."""
    least = (counts[-1] / counts[0]) ** 0.12
    kept = [float(counts[0])]
    for count in counts[1:]:
        if count >= kept[-1] * least:
            kept.append(float(count))
    return kept
