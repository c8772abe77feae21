"""Speed and memory of a run against the number of agents, for the testbed's own limits; no figure of the paper."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from deltaswarm_orchestrator.report.plots import style
from deltaswarm_orchestrator.report.plots.density import Floats

PANELS = (("steps_per_s", "steps per s", -1), ("rss_mb", "memory [MB]", 1))
"""Key, label, and the power of the number of agents that linear cost means: half the steps, or twice the memory."""

ONLY = "measured"
"""What the one line is called when rows name no variant."""

LINEAR = "linear in the number of agents"


def scale(
    rows: Sequence[Mapping[str, float | str]], *, width_in: float = style.TEXT_IN, height_in: float = 2.3
) -> Figure:
    """Steps per second and memory against the number of agents, both axes logarithmic.

    The thin dashed line is what cost linear in the number of agents would give from the smallest swarm on. Where a
    number of agents was measured more than once the line goes through the medians.

    Args:
        rows: dicts with `agents`, `steps_per_s`, `rss_mb` [MB], and perhaps `variant` (one line each).
        width_in: width [in].
        height_in: height [in].

    Raises:
        ValueError: no rows, a key that is missing, or a value that is not a positive number.
    """
    if not rows:
        raise ValueError("there are no rows")
    variants = list(dict.fromkeys(str(row.get("variant", ONLY)) for row in rows))
    with style.drawing():
        figure = style.new_figure(width_in, height_in)
        for axes, (key, label, power) in zip(figure.subplots(1, 2), PANELS, strict=True):
            for variant, look in style.looks(variants).items():
                own = [row for row in rows if row.get("variant", ONLY) == variant]
                _line(axes, _positive(own, "agents"), _positive(own, key), power, look, style.shown(variant))
            _finish(axes, _positive(rows, "agents"), label)
        _legend(figure, len(variants))
    return figure


def _positive(rows: Sequence[Mapping[str, float | str]], key: str) -> Floats:
    """The values (n,) of a key. Raises ValueError unless each is a finite number above 0."""
    values = []
    for row in rows:
        value = row.get(key)
        if not isinstance(value, int | float) or not 0 < value < float("inf"):
            raise ValueError(f"{key} = {value!r} with {row.get('agents')!r} agents: a number above 0 is expected")
        values.append(float(value))
    return np.array(values)


def _line(axes: Axes, agents: Floats, values: Floats, power: int, look: style.Look, name: str) -> None:
    counts = np.unique(agents)
    medians = np.array([np.median(values[agents == count]) for count in counts])
    linear = medians[0] * (counts / counts[0]) ** power
    axes.plot(counts, linear, color=style.GREY, linewidth=0.7, linestyle=(0, (6, 3)), label=LINEAR)
    axes.plot(counts, medians, color=look.colour, linestyle=look.line, marker=look.marker, markersize=4, label=name)
    axes.plot(agents, values, color=look.colour, linestyle="none", marker=".", markersize=3, label="each")


def _finish(axes: Axes, agents: Floats, label: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(FixedLocator(_apart(np.unique(agents))))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_tick_params(which="minor", length=0)
    axes.set_xlabel("number of agents")
    axes.set_ylabel(label)
    axes.grid(True, color=style.PALE, linewidth=0.5)
    axes.set_axisbelow(True)


def _apart(counts: Floats) -> list[float]:
    """The counts that can be written below a logarithmic axis without touching."""
    least = (counts[-1] / counts[0]) ** 0.12
    kept = [float(counts[0])]
    for count in counts[1:]:
        if count >= kept[-1] * least:
            kept.append(float(count))
    return kept


def _legend(figure: Figure, variants: int) -> None:
    handles, names = figure.axes[0].get_legend_handles_labels()
    once = dict(zip(names, handles, strict=True))
    del once["each"]
    once[LINEAR] = once.pop(LINEAR)  # last
    if variants == 1:
        once.pop(ONLY, None)
    figure.legend(once.values(), once.keys(), loc="outside upper center", ncols=len(once))
