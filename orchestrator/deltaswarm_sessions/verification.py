"""The command `deltaswarm verify`: whether sessions are those of a published hash, and whether their runs repeat."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError
from deltaswarm_orchestrator.cli.arguments import add_json, show
from deltaswarm_orchestrator.recording import COMMANDS, SCENARIO


def add_verify(command: argparse.ArgumentParser) -> None:
    """Check sessions against the published hash of their plan, and repeat their runs."""
    command.description = (
        "Check that plan and code of all sessions in a folder are those of a hash that was published before the study "
        "(deltaswarm session FILE --freeze), and repeat each complete run to its digest."
    )
    command.add_argument("data", type=Path, metavar="DATA", help="folder of all sessions, with the commitment")
    command.add_argument("--against", required=True, metavar="HASH", help="the hash that was published")
    add_json(command)
    command.set_defaults(func=verify)


def verify(arguments: argparse.Namespace) -> int:
    """Print what differs from the plan, and whether each run repeats; return FAILED if anything differs."""
    from deltaswarm_sessions.commitment import FILE, code_problems, read

    sessions: Path = arguments.data
    if not (entry := read(sessions)):
        raise CommandError(f"DATA must be a folder of sessions with a {FILE} (got {sessions}); --freeze writes it")
    problems = []
    if entry["hash"] != arguments.against.strip().lower():
        problems.append(
            f"--against must be the hash of {sessions / FILE} (got {arguments.against}, not {entry['hash']})"
        )
    problems += code_problems(entry)
    rows = list(_runs(sessions, entry))
    problems += [f"{row['run']}: {row['problem']}" for row in rows if row["problem"]]
    told = {"hash": entry["hash"], "date": entry["date"], "runs": rows, "problems": problems}
    repeated = sum(not row["problem"] for row in rows)
    lines = [
        f"frozen {entry['date']}: {entry['hash']}",
        f"{repeated} of {len(rows)} complete runs are as planned and repeat to their digests",
        *problems,
    ]
    show(arguments, told, "\n".join(lines))
    return FAILED if problems else OK


def _runs(sessions: Path, entry: dict[str, Any]) -> Iterator[dict[str, str]]:
    """Yield each complete run with what is wrong with it, which is empty if it is as planned and repeats."""
    from deltaswarm_sessions.commitment import settings_of
    from deltaswarm_sessions.folder import RECORD, attempt_number, read_record
    from deltaswarm_sessions.plan import order_and_numbers, run_folder, seed_of
    from deltaswarm_sessions.roster import allocated

    settings = settings_of(entry)
    for file in sorted(sessions.glob(f"participant-*/{RECORD}")):
        record = read_record(file.parent)
        order = order_and_numbers(settings, allocated(record))
        for run, (label, number) in zip(record["runs"], order, strict=False):
            for attempt in run["attempts"]:
                if attempt["complete"]:
                    folder = file.parent / attempt["folder"]
                    count = attempt_number(attempt["folder"], run_folder(run["place"], run["condition"]))
                    problem = _problem(folder, run["condition"], label, entry, seed_of(settings.seed, number, count))
                    yield {"run": f"{file.parent.name}/{folder.name}", "problem": problem}


def _problem(run: Path, condition: str, planned: str, entry: dict[str, Any], seed: int) -> str:
    from deltaswarm_orchestrator.run.in_process import run_in_process
    from deltaswarm_orchestrator.scenarios.load import load_scenario
    from deltaswarm_sessions.commitment import run_problems
    from deltaswarm_sessions.folder import summary_of

    if not run.exists():
        return "its folder was deleted"
    if condition != planned:
        return f"the condition must be {planned}, by the frozen order (got {condition})"
    scenario = load_scenario(str(run / SCENARIO))
    if changed := run_problems(entry, condition, seed, scenario):
        return f"must be as frozen (other values of {', '.join(changed[:8])})"
    orders = run / COMMANDS
    again = load_scenario(str(run / SCENARIO), commands=orders if orders.exists() else None)
    was, now = summary_of(run)["digest"], run_in_process(again).digest
    return "" if was == now else f"the digest must repeat (got {now}, not {was})"
