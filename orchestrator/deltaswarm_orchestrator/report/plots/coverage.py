"""Draw how a command spreads: one panel per range of the base, one line per share of frames lost."""

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from deltaswarm_orchestrator.report.plots import style


def coverage(found: Mapping[str, Any], *, width_in: float = style.TEXT_IN, height_in: float = 2.1) -> Figure:
    """Draw the share of agents that know a command against the time since it was sent.

    Args:
        found: the result of `bench.coverage.measure`.
        width_in: width [in].
        height_in: height [in].
    """
    ranges_m = list(dict.fromkeys(row["range_m"] for row in found["rows"]))
    losses = list(dict.fromkeys(row["loss"] for row in found["rows"]))
    looks = dict(zip(losses, style.OTHERS, strict=False))
    with style.drawing():
        figure = style.new_figure(width_in, height_in)
        panels = figure.subplots(1, len(ranges_m), sharex=True, sharey=True, squeeze=False)[0]
        for axes, range_m in zip(panels, ranges_m, strict=True):
            for row in (row for row in found["rows"] if row["range_m"] == range_m):
                look, shares = looks[row["loss"]], [100.0 * share for share in row["share_known"]]
                times_s = [found["step_s"] * step for step in range(len(shares))]
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
