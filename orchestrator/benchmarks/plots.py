"""Draw benchmarks: speed and memory against the number of agents, and how a command spreads."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from deltaswarm_orchestrator.base.disk import room_for
from deltaswarm_studies import style
from deltaswarm_studies.stats import Floats

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
    look = next(style.others())
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


def coverage(measured: Mapping[str, Any], *, width_in: float = style.TEXT_IN, height_in: float = 2.1) -> Figure:
    """Draw the share of agents that know a command against the time since it was sent.

    Args:
        measured: the result of `coverage.measure_coverage`.
        width_in: width [in].
        height_in: height [in].
    """
    ranges_m = list(dict.fromkeys(row["range_m"] for row in measured["rows"]))
    losses = list(dict.fromkeys(row["loss"] for row in measured["rows"]))
    looks = dict(zip(losses, style.others(), strict=False))
    with style.drawing():
        figure = style.new_figure(width_in, height_in)
        panels = figure.subplots(1, len(ranges_m), sharex=True, sharey=True, squeeze=False)[0]
        for axes, range_m in zip(panels, ranges_m, strict=True):
            for row in (row for row in measured["rows"] if row["range_m"] == range_m):
                look, shares = looks[row["loss"]], [100.0 * share for share in row["share_known"]]
                times_s = [measured["step_s"] * step for step in range(len(shares))]
                axes.plot(times_s, shares, color=look.colour, linestyle=look.line, label=f"{row['loss']:.0%}")
            axes.set_title("base heard everywhere" if range_m is None else f"base heard up to {range_m:g} m")
            axes.set_ylim(0, 103)
            axes.grid(True, color=style.PALE, linewidth=0.5)
        panels[0].set_ylabel("agents that know it [%]")
        panels[len(panels) // 2].set_xlabel("time since the command was sent [s]")
        figure.legend(
            handles=panels[0].lines, loc="outside upper center", ncols=len(losses), title="frames lost", frameon=False
        )
    return figure


def write(figure: Figure, path: Path) -> None:
    """Write a figure in all formats.

    Raises:
        RoomError: the disk is full.
    """
    with room_for(path):
        style.save(figure, path)
