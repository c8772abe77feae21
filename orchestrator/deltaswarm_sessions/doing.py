"""What `deltaswarm session` does: the runs of a participant, and the work on the folder of all participants."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_cli.arguments import show
from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_orchestrator.base.advice import as_given
from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError, notice
from deltaswarm_orchestrator.base.paths import check_files, check_out, check_ports
from deltaswarm_orchestrator.recording import PART
from deltaswarm_orchestrator.scenarios.load import language_at
from deltaswarm_sessions import IN_PROCESS, commitment, roster
from deltaswarm_sessions.datasets import DESCRIPTION, KINDS, export
from deltaswarm_sessions.folder import RECORD, folder_name, read_record
from deltaswarm_sessions.links import FILE, Links
from deltaswarm_sessions.plan import outline, outline_text, plan
from deltaswarm_sessions.runner import Runner
from deltaswarm_sessions.session import Session
from deltaswarm_sessions.settings import SessionSettings, load_session
from deltaswarm_sessions.tables import RUNS, WIDE, write_tables
from deltaswarm_sessions.trivial_questions import situation_warnings
from deltaswarm_sessions.variables import OF_SWARM

QUESTION = ("metric", "conditions", "effect", "power", "alpha", "test")
"""Options of --plan."""

NEEDS = dict.fromkeys(QUESTION, "plan") | {"reason": "withdraw", "wide": "table", "format": "table"}
"""Options that have no effect without another."""


class Begun(NamedTuple):
    """What is known of a participant's session before it begins or goes on."""

    kept: dict[str, Any]
    """What stays in its record."""
    warnings: list[str]
    before: tuple[str, dict[str, Any]]
    """The hash that is frozen, and the record; either may be empty."""


class Ready(NamedTuple):
    """A session whose checks are made."""

    runner: Runner
    settings: SessionSettings
    out: Path
    begun: Begun


def session(arguments: argparse.Namespace, do: Callable[[argparse.Namespace, Ready], int]) -> int:
    """Let `do` do the remaining runs of a participant's session, write the tables of all, or plan their number."""
    settings, beside = load_session(arguments.session)
    for name, needed in NEEDS.items():
        value = getattr(arguments, name)
        if value is not False and value not in (None, "", []) and getattr(arguments, needed) is None:
            raise CommandError(f"--{name} must be given with --{needed}, without which it has no effect")
    if arguments.plan is not None:
        return _plan(arguments, settings)
    out: Path = arguments.out or Path("sessions") / Path(arguments.session).stem
    out = out / roster.PILOT if arguments.pilot else out
    check_files(out)
    if arguments.freeze:
        file, found = commitment.freeze(settings, beside, out)
        show(arguments, {"file": str(file), "hash": found}, f"{found}\n{file}: keep it secret until the study is over")
        return OK
    if arguments.participant is None:
        return _keep(arguments, settings, out)
    return _do(arguments, settings, beside, out, do)


def _keep(arguments: argparse.Namespace, settings: SessionSettings, out: Path) -> int:
    """Work on the participants of a folder of sessions: number, withdraw, correct a number, write tables."""
    if arguments.table:
        check_out(arguments.table)
    with roster.held(out, only_reads=bool(arguments.table)) as is_writable:
        _finish(arguments, settings, out)
        if arguments.next:
            number = roster.next_number(settings, out, Links.read(out).numbers)
            show(arguments, number, _next_text(number))
        elif arguments.withdraw is not None:
            told = _withdraw(arguments, settings, out, arguments.withdraw)
            lines = [
                f"deleted: {told['deleted'] or 'nothing, there is no folder'}",
                *(f"written again without the participant: {folder}" for folder in told["tables"]),
                *(f"not reached: {what}" for what in told["not_reached"]),
            ]
            show(arguments, told, "\n".join(lines))
        elif arguments.renumber:
            _check_not_of_a_link(out, "--renumber", arguments.renumber[1])
            folder = roster.renumber(out, *arguments.renumber)
            show(arguments, {"folder": str(folder)}, str(folder))
        else:
            files = _tables(arguments, settings, out, is_writable=is_writable)
            show(arguments, [str(file) for file in files], "\n".join(map(str, files)))
    return OK


def _finish(arguments: argparse.Namespace, settings: SessionSettings, out: Path) -> None:
    """Finish what an earlier command began and did not end, unless this one is the same command again."""
    noted = roster.read(out)
    match noted.unfinished:
        case () | (arguments.withdraw,):
            return
        case (number,):
            _withdraw(arguments, settings, out, number)
        case (old, new):
            if arguments.renumber == [old, new]:
                return
            roster.renumber(out, old, new)
    notice(f"an earlier {noted.option} was interrupted; it is finished now")


def _tables(arguments: argparse.Namespace, settings: SessionSettings, out: Path, *, is_writable: bool) -> list[Path]:
    """Write the tables, and note where beforehand, so that a withdrawal finds even those that are cut off."""
    if is_writable:
        roster.note_tables(out, arguments.table)
    files = write_tables(out, arguments.table, settings.exclude, is_wide=arguments.wide)
    files += [export(kind, arguments.table, Path(arguments.session).stem) for kind in arguments.format]
    if not is_writable:
        notice(f"{arguments.table} cannot be noted in {out}, so --withdraw will not find the tables there")
    return files


def _do(
    arguments: argparse.Namespace,
    settings: SessionSettings,
    beside: Path,
    out: Path,
    do: Callable[[argparse.Namespace, Ready], int],
) -> int:
    participant: int = arguments.participant
    check_out(out)
    roster.check_number(out, participant)
    _check_not_of_a_link(out, "--participant", participant)
    begun = kept_of(settings, beside, out, participant, is_pilot=arguments.pilot)
    if arguments.language is not None:  # of this participant: no plan commits to it
        settings = replace(settings, language=language_at(arguments.language, Path()))
    runs = plan(settings, begun.kept.get("allocated", participant), beside)
    runner = Runner(
        session=Session(participant, runs, shows_score=settings.score, kept=begun.kept),
        folder=out / folder_name(participant),
        speed=settings.speed,
        in_process=arguments.agents == IN_PROCESS and not arguments.researcher,
        quiet=arguments.quiet,
        command=as_given(arguments),
    )
    pages = {"--station-listen": arguments.station_listen, "--markers": arguments.markers}
    check_ports({option: f"tcp/{address}" for option, address in pages.items() if address and ":" in address})
    for warning in [*begun.warnings, *runner.check()]:
        notice(warning)
    if arguments.dry_run:
        for warning in situation_warnings(runner.session.runs):
            notice(warning)
        outlined = outline(settings, runner.session.runs, is_concealed=not begun.before[1])
        show(arguments, outlined, outline_text(outlined))
        return OK
    code = do(arguments, Ready(runner, settings, out, begun))
    if code == OK:
        record = {name: value for name, value in read_record(runner.folder).items() if name != seal.SEAL}
        show(arguments, {"folder": str(runner.folder), **record}, str(runner.folder))
    return code


def _check_not_of_a_link(out: Path, option: str, number: int) -> None:
    """Refuse a number that is that of somebody who takes part by link: two people would share a session."""
    if number in Links.read(out).numbers:
        raise CommandError(
            f"{option} must not be a number that a link has (got {number}, in {out / FILE}); "
            "--next prints the number to use"
        )


def kept_of(settings: SessionSettings, beside: Path, out: Path, participant: int, *, is_pilot: bool) -> Begun:
    """Check a participant's session against the frozen plan.

    Raises:
        CommandError: it is that of another plan.
    """
    _, record = before = _state(out, participant)
    kept: dict[str, Any] = {name: record[name] for name in ("allocated", "corrected", "begun") if name in record}
    kept |= {"pilot": True} if is_pilot else {}
    frozen, warnings = commitment.check_plan(settings, beside, out)
    if record and (was := record.get("frozen", "")) != frozen:
        raise CommandError(
            f"{out / folder_name(participant)} must be a session of the plan that is frozen in {out}, "
            f"{frozen or 'none'} (got a session of {was or 'none'}): restore {roster.COMMITMENT}, or use another --out"
        )
    kept |= {"frozen": frozen} if frozen else {}
    kept |= {} if record else {"begun": provenance.now()}
    return Begun(kept, warnings, before)


def begin(runner: Runner, out: Path, begun: Begun) -> None:
    """Take the participant's folder, unless another command was faster."""
    participant = runner.session.participant
    out.mkdir(parents=True, exist_ok=True)
    with roster.held(out):  # what was checked before may have changed since
        roster.check_number(out, participant)
        if _state(out, participant) != begun.before:
            raise CommandError(f"{runner.folder} or the frozen plan was changed by another command; try again")
        roster.write(out, roster.read(out))
        runner.begin()
        roster.note_begun(out, participant)


def _state(out: Path, participant: int) -> tuple[str, dict[str, Any]]:
    """Return the hash that is frozen, and the participant's record; either may be empty."""
    folder = out / folder_name(participant)
    return commitment.read(out).get("hash", ""), read_record(folder) if (folder / RECORD).exists() else {}


def _next_text(found: dict[str, Any]) -> str:
    told = {"complete or under way": "counted", "begun and not complete": "not_complete", "withdrawn": "withdrawn"}
    lines = [f"{words}: {', '.join(map(str, found[name]))}" for words, name in told.items() if found[name]]
    return "\n".join([str(found["next"]), *lines])


def _withdraw(arguments: argparse.Namespace, settings: SessionSettings, out: Path, participant: int) -> dict[str, Any]:
    """Delete a participant's data and write the tables again; return what was reached and what was not."""
    removed = roster.withdraw(out, participant, arguments.reason)
    for folder in removed.tables:
        try:
            write_tables(out, folder, settings.exclude, is_wide=(folder / f"{WIDE}.tsv").exists())
            for kind in KINDS:
                if (folder / kind / DESCRIPTION).exists() or (folder / f"{kind}{PART}").exists():
                    export(kind, folder, Path(arguments.session).stem)
        except (OSError, CommandError) as error:
            raise CommandError(
                f"the withdrawal of {participant} is not finished: the tables in {folder} cannot be written again "
                f"({error}); mend that, then give the command again",
                FAILED,
            ) from None
    roster.write(out, roster.read(out)._replace(unfinished=()))
    return {
        "deleted": str(removed.folder) if removed.folder else None,
        "tables": [str(folder) for folder in removed.tables],
        "not_reached": [*(f"tables in {folder}" for folder in removed.not_there), roster.BEYOND_REACH],
    }


def _plan(arguments: argparse.Namespace, settings: SessionSettings) -> int:
    from deltaswarm_sessions.pilot import Question, plan_participants, text  # imports SciPy

    check_files(arguments.plan)
    asked: dict[str, Any] = {name: value for name in QUESTION if (value := getattr(arguments, name)) is not None}
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
