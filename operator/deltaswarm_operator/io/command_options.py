"""Command-line options for commands and the station of an operator in open air."""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltaswarm_operator import ANY_PORT
from deltaswarm_scenario.operator_links import CommandSettings
from deltaswarm_scenario.operator_settings import Briefing, OperatorSettings, begun_with
from deltaswarm_scenario.techniques import ProbeSettings
from deltaswarm_wire import checked
from deltaswarm_wire.commands import CommandForm, forms_of, named
from deltaswarm_wire.plugins import controller_settings, find_controller
from deltaswarm_wire.reading import read_toml
from deltaswarm_wire.settings import AgentSettings
from deltaswarm_wire.signing import Sign, signer

NO_KEY = "needs --command-key FILE, whose public part the boards know; make one: deltaswarm certificates --operator-key"


@dataclass(frozen=True)
class CommandOptions:
    briefing: Briefing
    sign: Sign | None
    """Signs commands; None: no commands, the station only watches."""
    board_step_s: float
    """Length of the boards' steps [s]."""
    listen: str | None
    """HOST:PORT of the station's page; None: no station."""


@dataclass(frozen=True)
class _Script:
    command: tuple[CommandSettings, ...] = checked.key((), "commands, by the time since the operator's start")


def command_options_of(
    arguments: argparse.Namespace, settings: OperatorSettings, step_s: float
) -> CommandOptions | None:
    """Read the arguments; return None if the operator only counts.

    Raises:
        ValueError, OSError: the arguments contradict each other, or a named file is wrong.
    """
    if arguments.station_listen and not arguments.station:
        raise ValueError("--station-listen needs --station")
    for option in ("--controller", "--commands"):
        if getattr(arguments, option.removeprefix("--")) and not arguments.command_key:
            raise ValueError(f"{option} {NO_KEY}")
    if not arguments.station and not arguments.commands:
        if option := next((name for name in ("command_key", "task", "base") if getattr(arguments, name)), ""):
            raise ValueError(f"--{option.replace('_', '-')} needs --station or --commands")
        return None
    task = _task(arguments.task, arguments.controller)
    forms: tuple[CommandForm, ...] = ()
    if arguments.command_key:
        if not arguments.controller and not arguments.task:
            raise ValueError("--command-key needs --controller or --task, which say which commands boards accept")
        forms = begun_with(forms_of(find_controller(task.control.mode, "--controller")), task.control.options)
    briefing = Briefing(
        title=f"open air, {task.control.mode}" if forms else "open air",
        mode=task.control.mode,
        step_s=step_s,
        width_m=task.width_m,
        height_m=task.height_m,
        obstacles=task.obstacles,
        base_m=arguments.base,
        agents=len(arguments.agents),
        radius_m=task.radius_m,
        operator=OperatorSettings(settings.threshold_hz, probes=ProbeSettings(isa_every_s=0.0)),
        forms=forms,
        command=_script(arguments.commands, forms),
    )
    sign = signer(arguments.command_key, arguments.run) if arguments.command_key else None
    listen = (arguments.station_listen or ANY_PORT) if arguments.station else None
    return CommandOptions(briefing, sign, task.step_s, listen)


def _task(file: Path | None, mode: str | None) -> AgentSettings:
    """Read the boards' task; a given mode replaces its controller."""
    table: Any = _read(file) if file else {}
    table = table.get("agent", {})
    if mode:
        control = {"mode": mode} | ({} if not file else _options_of(table, mode))
        table = {**table, "control": control}
    task = checked.load(AgentSettings, table, "agent")
    controller_settings(task.control.mode, task.control.options, task, "agent.control")
    return task


def _options_of(table: Any, mode: str) -> dict[str, Any]:
    """Return a file's controller options if they are for this controller."""
    control = table.get("control", {})
    return dict(control) if control.get("mode") == mode else {}


def _script(file: Path | None, forms: tuple[CommandForm, ...]) -> tuple[CommandSettings, ...]:
    if file is None:
        return ()
    commands = checked.load(_Script, _read(file)).command
    for number, given in enumerate(commands):
        form = named(forms, given.name)
        if form is None:
            known = ", ".join(form.name for form in forms) or "none"
            raise ValueError(f"{file}: command.{number}.name must be one of {known} (got {given.name!r:.40})")
        if problem := form.problem(given.command(0).target, given.arguments):
            raise ValueError(f"{file}: command.{number}: {problem}")
    return commands


def _read(file: Path) -> dict[str, Any]:
    try:
        return read_toml(file)
    except ValueError as error:
        raise ValueError(f"{file} {error}") from None
