"""The commands `deltaswarm branch` and `deltaswarm value`: read their options, and print what comes of them."""

import argparse
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_branches.keys import LATER
from deltaswarm_cli.arguments import A_RUN, Group, add_json, add_quiet, show
from deltaswarm_orchestrator.base.exits import OK, CommandError, aligned, notice
from deltaswarm_orchestrator.base.paths import check_out, free_folder, part_of
from deltaswarm_orchestrator.processes.elsewhere import IN_ONE_PROCESS
from deltaswarm_orchestrator.recording import VALUES
from deltaswarm_wire import checked
from deltaswarm_wire.arguments import number, whole
from deltaswarm_wire.checked import Problem, SettingsError

if TYPE_CHECKING:
    from deltaswarm_branches.pairs import Work
    from deltaswarm_branches.parent import Parent
    from deltaswarm_scenario.operator_links import CommandSettings

ADDED = "--add-command"


def add_branch(command: argparse.ArgumentParser) -> None:
    """Go on from a step of a run with something different: an order less or more, a setting, a mode."""
    command.description = (
        "Repeat a run, check its digest, and go on from one of its steps in a new run with something different: "
        "without an order, with another, or with other settings. Events and random draws are the same, as far as "
        "both have them. See docs/BRANCHES.md."
    )
    command.add_argument("run", type=Path, metavar="RUN", help=A_RUN)
    group = command.add_argument_group("what is different")
    group.add_argument(
        "--at",
        type=number(0.0),
        metavar="S",
        help="time from which on it is different [s] (default: when the first dropped order left the base)",
    )
    group.add_argument(
        "--drop-command",
        type=whole(0),
        action="append",
        default=[],
        metavar="N",
        help="number of an order that is not given, as in commands.csv",
    )
    group.add_argument(
        ADDED,
        action="append",
        default=[],
        metavar="TOML",
        help="an order that is given besides, as in a scenario: 'name=\"set delta\", arguments={delta=3}' (at_s: --at)",
    )
    group.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting from then on")
    group.add_argument("--mode", metavar="MODE", help="control mode from then on; short for --set control.mode=MODE")
    add_later(group)
    group = command.add_argument_group("output")
    add_replicates(group, 0, "also do both runs with other random draws from that step on, and compare them in pairs")
    group.add_argument("--processes", action="store_true", help="go on with real processes (default: in one process)")
    group.add_argument("--out", type=Path, metavar="FOLDER", help="folder of the new run (default: runs/NAME-atS)")
    group.add_argument("--force", action="store_true", help="replace the folder if it exists")
    add_json(group)
    add_quiet(group)
    command.set_defaults(func=branch, makes_files=True, handles_signals=True)


def add_replicates(group: Group, default: int, what: str) -> None:
    """Add `--replicates`, `--jobs` and `--engine`."""
    group.add_argument(
        "--replicates", type=whole(0), default=default, metavar="N", help=f"{what}, N times (default: {default})"
    )
    group.add_argument("-j", "--jobs", type=whole(1), metavar="N", help="runs in parallel (default: number of cores)")
    group.add_argument(
        "--engine",
        choices=IN_ONE_PROCESS,
        default="",
        help="engine of these runs (default: dense where it is installed and covers them)",
    )


def add_value(command: argparse.ArgumentParser) -> None:
    """Estimate the effect of each order of a run: the run with it, and without it."""
    command.description = (
        "Repeat a run with and without each of its orders, as it was and in replicates with other random draws from "
        "that step on, and write the effect of each order on waiting, told, completed and messages into RUN/value. "
        "`deltaswarm replay` shows it beside the order. See docs/BRANCHES.md."
    )
    command.add_argument("run", type=Path, metavar="RUN", help=A_RUN)
    command.add_argument(
        "--command",
        type=whole(0),
        action="append",
        default=[],
        dest="orders",
        metavar="N",
        help="only this order; repeatable",
    )
    add_replicates(command, 20, "do both runs with other random draws")
    add_later(command)
    add_json(command)
    add_quiet(command)
    command.set_defaults(func=value, makes_files=True)


def value(arguments: argparse.Namespace) -> int:
    """Compare a run with itself without each of its orders; print and write the effects."""
    from deltaswarm_branches.parent import read_parent
    from deltaswarm_branches.value import in_words, value_of_command, write

    parent = read_parent(arguments.run)
    _check_engine(parent, arguments.engine)
    check_out(parent.folder / VALUES, "RUN/value")
    _say_if_too_few(arguments.replicates, len(set(arguments.orders)) or len(parent.orders))
    rows, found, later = value_of_command(
        parent,
        arguments.orders,
        replicates=arguments.replicates,
        later=arguments.later,
        jobs=_jobs(arguments),
        engine=arguments.engine,
        done=_say_done,
    )
    files = write(parent, rows, found, replicates=arguments.replicates, later=later)
    told = [{"order": row.order.number, **row.effect._asdict()} for row in rows]
    lines = [(f"{row.order.number} {row.order.command.name}", row.effect.measure, in_words(row.effect)) for row in rows]
    result = {"files": list(map(str, files)), "later_orders": later, "orders": told}
    show(arguments, result, f"{aligned(lines)}\n{files[0]}")
    return OK


def _check_engine(parent: "Parent", asked: str) -> None:
    """Refuse an engine that cannot do even the parent, before hours are spent on it. Raises CommandError."""
    from deltaswarm_orchestrator.run.choosing import planned_by

    if asked:
        planned_by(parent.scenario, asked=asked)


def _say_done(count: int, of: int) -> None:
    if count % 20 == 0 or count == of:
        notice(f"{count} of {of} pairs of runs")


def _say_if_too_few(replicates: int, orders: int) -> None:
    from deltaswarm_branches.effects import replicates_needed
    from deltaswarm_branches.pairs import MEASURES

    comparisons = orders * len(MEASURES)
    if replicates < (least := replicates_needed(comparisons)):
        notice(f"--replicates should be at least {least} to decide anything in {comparisons} comparisons")


def _jobs(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, default_workers

    return arguments.jobs or default_workers(IN_PROCESS)


def add_later(group: Group) -> None:
    """Add `--later`."""
    group.add_argument(
        "--later",
        choices=LATER,
        default="",
        help="later orders: kept: given in the same steps (default); dropped: not given; decided: anew, by the "
        "simulated person or the system (default if one of them gives orders)",
    )


def branch(arguments: argparse.Namespace) -> int:
    """Make a branch, and print its results."""
    from deltaswarm import runs
    from deltaswarm_branches.folder import prepare
    from deltaswarm_branches.pairs import Comparison, Work
    from deltaswarm_branches.parent import read_parent
    from deltaswarm_branches.plan import Difference, at_step, plan
    from deltaswarm_branches.repetition import repeat
    from deltaswarm_cli.report import run_and_report
    from deltaswarm_orchestrator.base.signals import heed_signals_again
    from deltaswarm_orchestrator.results.folder import check_target
    from deltaswarm_orchestrator.run.options import RunOptions

    if arguments.engine and not arguments.replicates:
        raise CommandError("--engine must be given with --replicates: it is the engine of these")
    parent, drop = read_parent(arguments.run), tuple(arguments.drop_command)
    _check_engine(parent, arguments.engine)
    step = at_step(parent, arguments.at, drop)
    at_s = step * parent.step_s
    added = tuple(_added(text, at_s) for text in arguments.add_command)
    sets = [*arguments.set, *([f"control.mode={arguments.mode}"] if arguments.mode else [])]
    difference = Difference(drop, added, tuple(sets), arguments.later)
    planned = plan(parent, step, difference)
    unchanged = planned
    if arguments.replicates:
        import deltaswarm_branches.value  # noqa: F401 (needs the extra study, which is said before the runs)

        unchanged = plan(parent, step, Difference())
        _say_if_too_few(arguments.replicates, 1)
    out = arguments.out or free_folder(Path("runs") / f"{parent.scenario.name}-at{at_s:g}")
    if parent.folder.resolve() in (out.resolve(), part_of(out).resolve()):
        raise CommandError(f"--out must be another folder than RUN's, from which the branch is made (got {out})")
    check_target(out, arguments.force)
    part, is_in_process = part_of(out), not arguments.processes
    force: bool = arguments.force
    options = RunOptions(out=part, in_process=is_in_process, force=force, inputs=planned.inputs, resume=True)
    runs.check(planned.scenario, options)
    notice(f"branch of {parent.folder} at {at_s:g} s (step {step}): {difference.text}; later orders: {planned.later}")
    with runs.display_of(parent.scenario, quiet=arguments.quiet) as display:
        repetition = repeat(parent, [planned.turn_step], display, needs_console=planned.changes_console)
    engine = "processes" if arguments.processes else "in-process"
    _, scenario = prepare(repetition, planned, difference, out, engine, force=force)
    code = run_and_report(scenario, options, quiet=arguments.quiet, as_json=arguments.json)
    if arguments.replicates and code == OK:
        heed_signals_again()
        _compare(Work(repetition, [Comparison(planned, unchanged)], arguments.engine), out, arguments)
    return code


def _compare(work: "Work", out: Path, arguments: argparse.Namespace) -> None:
    """Compare a branch with its parent over replicates; write the tables into its folder, and say what is found."""
    from deltaswarm_branches.effects import effects
    from deltaswarm_branches.pairs import pairs
    from deltaswarm_branches.value import in_words, write_difference

    found = pairs(work, arguments.replicates, _jobs(arguments), _say_done)
    rows = effects(found)
    record = {"parent": work.repetition.parent.identity, "replicates": arguments.replicates}
    files = write_difference(out, record, rows, found)
    notice(f"branch minus parent, over {arguments.replicates} replicates:")
    notice(aligned((row.measure, in_words(row)) for row in rows))
    notice(str(files[0]))


def _added(text: str, at_s: float) -> "CommandSettings":
    """Read an order from a TOML table: its lines, or one line with or without braces; it leaves at the branching point.

    Raises:
        SettingsError: it is no order.
    """
    from deltaswarm_scenario.operator_links import CommandSettings

    inner = text.strip()
    if "\n" not in inner:  # else lines of TOML, as in a scenario
        inner = f"command = {inner}" if inner.startswith("{") else f"command = {{{inner}}}"
    try:
        table = tomllib.loads(inner)
    except (ValueError, RecursionError) as error:
        must = "must be an order as in a scenario, such as 'name=\"set delta\", arguments={delta=3}'"
        reason = str(error).partition(" (at ")[0]  # a place in another text
        raise SettingsError([Problem(ADDED, f"{text!r}; {reason}", must)]) from None
    table = table["command"] if table.keys() == {"command"} else table
    return checked.load(CommandSettings, {"at_s": at_s, **table}, ADDED)
