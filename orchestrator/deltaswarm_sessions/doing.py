"""What `deltaswarm session` does, by its options."""

import argparse
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.advice import as_given
from deltaswarm_orchestrator.base.exits import OK, CommandError, notice
from deltaswarm_orchestrator.base.output import results_on
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_orchestrator.cli.arguments import show
from deltaswarm_orchestrator.processes.station import LOOPBACK
from deltaswarm_orchestrator.scenarios.load import language_at
from deltaswarm_sessions import commitment, roster
from deltaswarm_sessions.datasets import DESCRIPTION, KINDS, export
from deltaswarm_sessions.folder import RECORD, folder_name, read_record
from deltaswarm_sessions.giveaways import situation_warnings
from deltaswarm_sessions.plan import outline, outline_text, plan
from deltaswarm_sessions.runner import Runner
from deltaswarm_sessions.session import Session
from deltaswarm_sessions.settings import SessionSettings, load_session
from deltaswarm_sessions.tables import RUNS, WIDE, write_tables
from deltaswarm_sessions.variables import OF_SWARM

QUESTION = ("metric", "conditions", "effect", "power", "alpha", "test")
"""Options of --plan."""


def session(arguments: argparse.Namespace) -> int:
    """Do the remaining runs of a participant's session, write the tables of all participants, or plan their number."""
    settings, beside = load_session(arguments.session)
    asked = {name: value for name in QUESTION if (value := getattr(arguments, name)) is not None}
    if asked and arguments.plan is None:
        raise CommandError(f"--{next(iter(asked))} must be given with --plan, without which it has no effect")
    if arguments.plan is not None:
        return _plan(arguments, settings, asked)
    out: Path = arguments.out or Path("sessions") / Path(arguments.session).stem
    out = out / roster.PILOT if arguments.pilot else out
    if arguments.reason and arguments.withdraw is None:
        raise CommandError("--reason must be given with --withdraw, without which it has no effect")
    if arguments.freeze:
        file, found = commitment.freeze(settings, beside, out)
        show(arguments, {"file": str(file), "hash": found}, f"{found}\n{file}: keep it secret until the study is over")
        return OK
    if arguments.wide and not arguments.table:
        raise CommandError("--wide must be given with --table, without which it has no effect")
    if arguments.format and not arguments.table:
        raise CommandError("--format must be given with --table, without which it has no effect")
    if arguments.next:
        number = roster.next_number(settings, out)
        show(arguments, number, _next_text(number))
        return OK
    if arguments.withdraw is not None:
        return _withdraw(arguments, settings, out)
    if arguments.renumber:
        folder = roster.renumber(out, *arguments.renumber)
        show(arguments, {"folder": str(folder)}, str(folder))
        return OK
    if arguments.table:
        check_out(arguments.table)
        files = write_tables(out, arguments.table, settings.exclude, is_wide=arguments.wide)
        roster.note_tables(out, arguments.table)
        files += [export(kind, arguments.table, Path(arguments.session).stem) for kind in arguments.format]
        show(arguments, [str(file) for file in files], "\n".join(map(str, files)))
        return OK
    if arguments.language is not None:
        settings = replace(settings, language=language_at(arguments.language, Path()))
    return _do(arguments, settings, beside, out)


def _as_in_file(arguments: argparse.Namespace, settings: SessionSettings) -> SessionSettings:
    """Return the settings without the language of one participant, to which no plan commits."""
    return settings if arguments.language is None else load_session(arguments.session)[0]


def _do(arguments: argparse.Namespace, settings: SessionSettings, beside: Path, out: Path) -> int:
    """Do the remaining runs of one participant, or print which they are."""
    participant: int = arguments.participant
    check_out(out)
    roster.check_number(out, participant)
    folder = out / folder_name(participant)
    record = read_record(folder) if (folder / RECORD).exists() else {}
    kept: dict[str, Any] = {name: record[name] for name in ("allocated", "corrected") if name in record}
    kept |= {"pilot": True} if arguments.pilot else {}
    frozen, warnings = commitment.check_plan(_as_in_file(arguments, settings), beside, out)
    kept |= {"frozen": frozen} if frozen else {}
    runs = plan(settings, kept.get("allocated", participant), beside)
    runner = Runner(
        session=Session(participant, runs, shows_score=settings.score, kept=kept),
        folder=folder,
        speed=settings.speed,
        listen=arguments.station_listen or LOOPBACK,
        markers=arguments.markers or "",
        researcher=arguments.researcher,
        quiet=arguments.quiet,
        command=as_given(arguments),
    )
    for warning in [*warnings, *runner.check()]:
        notice(warning)
    if arguments.dry_run:
        for warning in situation_warnings(runner.session.runs):
            notice(warning)
        outlined = outline(settings, runner.session.runs, is_concealed=not runner.has_begun)
        show(arguments, outlined, outline_text(outlined))
        return OK
    with results_on(sys.stderr) if arguments.json else nullcontext():
        code = runner.run()
    if code == OK:
        show(arguments, {"folder": str(runner.folder), **runner.session.record}, str(runner.folder))
    return code


def _next_text(found: dict[str, Any]) -> str:
    """Format the result of `next_number`."""
    told = {"complete or under way": "counted", "begun and not complete": "not_complete", "withdrawn": "withdrawn"}
    lines = [f"{words}: {', '.join(map(str, found[name]))}" for words, name in told.items() if found[name]]
    return "\n".join([str(found["next"]), *lines])


def _withdraw(arguments: argparse.Namespace, settings: SessionSettings, out: Path) -> int:
    """Delete a participant's data and write the tables again; print what was reached and what was not."""
    removed = roster.withdraw(out, arguments.withdraw, arguments.reason)
    for folder in removed.tables:
        write_tables(out, folder, settings.exclude, is_wide=(folder / f"{WIDE}.tsv").exists())
        for kind in [kind for kind in KINDS if (folder / kind / DESCRIPTION).exists()]:
            export(kind, folder, Path(arguments.session).stem)
    told: dict[str, Any] = {
        "deleted": str(removed.folder) if removed.folder else None,
        "tables": [str(folder) for folder in removed.tables],
        "not_reached": [*(f"tables in {folder}" for folder in removed.not_there), roster.BEYOND_REACH],
    }
    lines = [
        f"deleted: {told['deleted'] or 'nothing, there is no folder'}",
        *(f"written again without the participant: {folder}" for folder in told["tables"]),
        *(f"not reached: {what}" for what in told["not_reached"]),
    ]
    show(arguments, told, "\n".join(lines))
    return OK


def _plan(arguments: argparse.Namespace, settings: SessionSettings, asked: dict[str, Any]) -> int:
    """Print how many participants are needed to find a difference between two conditions."""
    from deltaswarm_sessions.pilot import Question, plan_participants, text  # imports SciPy

    effect = asked.get("effect")
    if effect is not None and ("metric" not in asked or not effect):
        raise CommandError("--effect must be a difference other than 0, given with the --metric in whose unit it is")
    planned = plan_participants(settings, arguments.plan / f"{RUNS}.tsv", Question(**asked))
    if of_swarm := [name for name in OF_SWARM if name in planned["metrics"]]:
        notice(
            f"measures of the swarm, not of the person: {', '.join(of_swarm)}; participants with the same stream "
            "and no orders have the same value and are no replicates"
        )
    if effect is None:
        notice(
            "the effect is the pilot's own, which is uncertain: give the least difference that matters by --effect, "
            "with --metric"
        )
    show(arguments, planned, text(planned))
    return OK
