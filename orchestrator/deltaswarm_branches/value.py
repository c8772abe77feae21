"""The effect of each order of a run: the run with it and without it, in a table and a figure beside the run."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from deltaswarm_branches.effects import Effect, OrderEffect, effects
from deltaswarm_branches.figure import draw
from deltaswarm_branches.keys import DROPPED, KEPT
from deltaswarm_branches.pairs import MEASURES, Comparison, Pair, Work, engines, pairs
from deltaswarm_branches.parent import Order, Parent
from deltaswarm_branches.plan import Difference, plan
from deltaswarm_branches.repetition import repeat
from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import Reporter
from deltaswarm_orchestrator.recording import VALUES
from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.commands import Target

TABLE, DIFFERENCE, REPLICATES, FIGURE = "commands_value.csv", "difference.csv", "replicates.csv", "commands_value"

ORDER_COLUMNS = ("order", "at_s", "name", "target", "by")


def value_of_command(
    parent: Parent,
    numbers: Sequence[int] = (),
    *,
    replicates: int = 20,
    later: str = "",
    jobs: int = 1,
    engine: str = "",
    done: Callable[[int, int], None] = lambda count, of: None,
) -> tuple[list[OrderEffect], list[Pair], str]:
    """Compare a run with itself without each of some orders (default: all), one at a time.

    Return the effect of each order on each measure, the pairs of runs behind it, and what became of later orders.

    Raises:
        SettingsError: there is no such order, or none at all.
        CommandError: the run does not repeat, or a run failed.
    """
    orders = _orders(parent, numbers)
    comparisons = [Comparison(*_plans(parent, order, later)) for order in orders]
    at = [each.with_it.turn_step for each in comparisons]
    repetition = repeat(parent, at, Reporter(), needs_console=True)
    found = pairs(Work(repetition, comparisons, engine), replicates, jobs, done)
    rows = [OrderEffect(orders[effect.comparison], effect) for effect in effects(found)]
    return rows, found, comparisons[0].with_it.later if later != DROPPED else DROPPED


def _orders(parent: Parent, numbers: Sequence[int]) -> list[Order]:
    known = {order.number: order for order in parent.orders}
    if wrong := [number for number in numbers if number not in known]:
        must = f"must be an order that left the base: 0 to {len(known) - 1}" if known else "must be left out"
        raise SettingsError([Problem("--command", ", ".join(map(str, wrong)), must)])
    if not known:
        raise SettingsError([Problem("RUN", str(parent.folder), "must be a run in which an order left the base")])
    return [known[number] for number in dict.fromkeys(numbers or known)]


def _plans(parent: Parent, order: Order, later: str) -> Iterable[Any]:
    """Return the plans with an order and without it; under `dropped` neither has the orders after it."""
    both: tuple[int, ...] = ()
    only = Difference(drop=(order.number,), later=later)
    if later == DROPPED:
        left = order.step, order.number  # of orders in one step, those with greater numbers come later
        both = tuple(other.number for other in parent.orders if (other.step, other.number) > left)
        only = Difference(drop=(*both, order.number), later=KEPT)
    return (plan(parent, order.step, each) for each in (Difference(drop=both, later=only.later), only))


def write(
    parent: Parent, rows: Sequence[OrderEffect], found: Sequence[Pair], *, replicates: int, later: str
) -> list[Path]:
    """Write table, replicates and figure beside a run's results, sealed with the run's identity; return the files.

    Raises:
        OSError: they cannot be written.
    """
    folder = _unsealed(parent.folder / VALUES)
    write_csv(folder / TABLE, (*ORDER_COLUMNS, *Effect._fields[1:]), (_cells(row, parent.step_s) for row in rows))
    orders = {row.effect.comparison: row.order.number for row in rows}
    _write_pairs(folder, found, orders)
    figures = draw(rows, folder / FIGURE)
    texts = {str(number): _text(rows, number) for number in orders.values()}
    record = {"run": parent.identity, "replicates": replicates, "later_orders": later, "texts": texts}
    return _seal(folder, record | engines(found), [TABLE, REPLICATES, *(file.name for file in figures)])


def write_difference(branch: Path, record: dict[str, Any], rows: Sequence[Effect], found: Sequence[Pair]) -> list[Path]:
    """Write how a branch differs from its parent over replicates into the branch's folder, sealed; return the files.

    Raises:
        OSError: they cannot be written.
    """
    folder = _unsealed(branch / VALUES)
    write_csv(folder / DIFFERENCE, Effect._fields[1:], (row[1:] for row in rows))
    _write_pairs(folder, found, {})
    return _seal(folder, record | engines(found), [DIFFERENCE, REPLICATES])


def _unsealed(folder: Path) -> Path:
    """Make a folder, or take the seal off what is in it, which counts as incomplete until all of it is replaced."""
    folder.mkdir(exist_ok=True)
    (folder / seal.RECORD).unlink(missing_ok=True)
    return folder


def _write_pairs(folder: Path, found: Sequence[Pair], orders: Mapping[int, int]) -> None:
    header = ("order", "replicate", *(f"{name}_{side}" for side in ("with", "without") for name in MEASURES))
    sides = ([*pair.with_it.values(), *pair.without.values()] for pair in found)
    heads = ([orders.get(pair.comparison), pair.replicate] for pair in found)
    write_csv(folder / REPLICATES, header, (head + side for head, side in zip(heads, sides, strict=True)))


def _seal(folder: Path, record: dict[str, Any], names: Sequence[str]) -> list[Path]:
    seal.write_sealed(folder / seal.RECORD, {**record, "measures": MEASURES}, seal.digests(folder, names))
    return [folder / name for name in names]


def _cells(row: OrderEffect, step_s: float) -> list[Any]:
    number, step, by, command = row.order
    return [number, step * step_s, command.name, Target(command.target, command.numbers), by, *row.effect[1:]]


def _text(rows: Sequence[OrderEffect], number: int) -> str:
    """Return a line with the effect of an order, for the page."""
    own = [row.effect for row in rows if row.order.number == number]
    parts = [f"{effect.measure} {in_words(effect)}" for effect in own]
    return f"worth: {'; '.join(parts)}"


def in_words(effect: Effect) -> str:
    """Format an effect."""
    unit = f" {effect.unit}" if effect.unit else ""
    if effect.estimate is None:
        return "-" if effect.value is None else f"{effect.value:+.3g}{unit} in one run"
    ends = "" if effect.low is None or effect.high is None else f" ({effect.low:+.3g} to {effect.high:+.3g})"
    return f"{effect.estimate:+.3g}{unit}{ends}, {effect.verdict}"
