"""`CLAIMS.md`: every claim with the command that checks it, what to expect, how long it takes, what it writes."""

from collections.abc import Iterator

from deltaswarm_orchestrator.analysis.markdown import table
from deltaswarm_orchestrator.analysis.words import number
from deltaswarm_orchestrator.reproduction.conditions import FIGURES, LARGE_READINGS
from deltaswarm_orchestrator.reproduction.paper_claims import (
    CONVERGENCE,
    LARGE_VALUES,
    LIKENESSES,
    ORDERS,
    REMARKS,
    VALUES,
)

MINUTES = {2: 5, 3: 28, 4: 7, 5: 16}
"""What the runs of a figure take on 2 cores, about [min]."""

HEAD = """\
# Claims

What the paper says, the command that checks it here, and what to expect. `deltaswarm reproduce --full` checks all
of it, `deltaswarm reproduce --quick` (below 10 minutes) most of it on fewer and shorter runs. Both write
`report.html`, `report.md`, `claims.csv` and `figures/` below `reproduction/full` or `reproduction/quick`, and end
with exit code 3 if a claim does not hold that is expected to (the quick one: an order, not a value). A second
command that needs the same runs finds them done. Claims that we expect not to hold come first; why is said below.
"""


def claims_page() -> str:
    """The whole page. A test holds that the file is what this gives."""
    rows = sorted(_rows(), key=lambda row: row[0] not in REMARKS)
    reasons = "\n".join(f"- **{name}**: {reason}" for name, reason in REMARKS.items())
    titles = ("claim", "the paper", "expected here", "command", "minutes", "figure in `figures/`")
    return f"{HEAD}\n{table(titles, rows, [False] * 4 + [True, False])}\n\n## Why some do not hold\n\n{reasons}\n"


def _rows() -> Iterator[tuple[str, ...]]:
    for one in VALUES:
        yield _row(one.name, f"{number(one.paper)} {one.unit}", _range(one.within, one.unit), {one.variant})
    for order in ORDERS:
        least = f"at least {order.at_least_ratio:g} times, p < 0.05" if order.at_least_ratio else "p < 0.05"
        yield _row(order.name, order.text, least, {order.less, order.more})
    for like in LIKENESSES:
        margin = f"less than {like.margin:g} {like.unit} apart, p < 0.05"
        yield _row(like.name, like.text, margin, {like.one, like.other})
    for variant in LARGE_READINGS:
        for name, _, paper, unit, within in LARGE_VALUES:
            yield _row(f"{name}, {variant}", f"{number(paper)} {unit}", _range(within, unit), {variant})
    for variant, paper, within in CONVERGENCE:
        yield _row(f"time to converge, {variant}", f"{number(paper)} s", _range(within, "s"), {variant})


def _range(within: tuple[float, float], unit: str) -> str:
    return f"{within[0]:g} to {within[1]:g} {unit}".rstrip()


def _row(name: str, paper: str, expected: str, variants: set[str]) -> tuple[str, ...]:
    """The first of the cheapest figures that needs these variants."""
    figure = next(figure for figure in sorted(MINUTES, key=MINUTES.__getitem__) if variants <= set(FIGURES[figure]))
    expected = "not to hold" if name in REMARKS else expected
    command = f"`deltaswarm reproduce --full --figure {figure}`"
    return name, paper.rstrip(), expected, command, str(MINUTES[figure]), f"`figure-{figure}.png`"
