"""Make the page of all commands, docs/COMMANDS.md, from their parsers."""

import argparse
import re
import textwrap
from collections.abc import Iterator

from deltaswarm_agent.__main__ import parser as agent
from deltaswarm_board.__main__ import parser as board
from deltaswarm_cli.main import all_commands, parser
from deltaswarm_operator.__main__ import parser as operator
from deltaswarm_world.__main__ import parser as world

HEAD = """\
# Commands

With `--json` a command prints its result as one JSON document on standard output, and nothing else there; progress,
notices and errors are on standard error. Two commands have no result to read: `deltaswarm replay` serves a page until
it is interrupted, and `deltaswarm completion` prints a script.
"""

WIDTH = 100
"""Columns of a usage line, whatever the terminal."""

PLACEHOLDERS = {"?": "[{}]", "*": "[{} ...]", "+": "{} [{} ...]"}


def reference() -> str:
    """Return docs/COMMANDS.md: usage, description and options of every command."""
    lines = [HEAD.rstrip()]
    for command in every_parser():
        lines += ["", f"## {command.prog}", "", *described(command)]
    return "\n".join(lines) + "\n"


def every_parser() -> Iterator[argparse.ArgumentParser]:
    """Yield the parser of `deltaswarm` and of each of its commands and parts."""
    yield parser()
    for name in all_commands():
        yield from with_subcommands(subparsers(parser(name))[name])
    yield from (agent(), board(), world(), operator())


def with_subcommands(command: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Yield a parser and those of its subcommands."""
    yield command
    for below in subparsers(command).values():
        yield from with_subcommands(below)


def subparsers(command: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of a parser's commands, by name."""
    found = (action.choices for action in command._actions if isinstance(action, argparse._SubParsersAction))
    return dict(next(found, {}))


def described(command: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the lines of the page about a parser."""
    if command.description:
        yield from (marked(" ".join(command.description.split())), "")
    yield from ("```text", *usage(command), "```")
    for action in command._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from ("", "| command | meaning |", "| --- | --- |")
            yield from (f"| `{choice.dest}` | {cell(choice.help)} |" for choice in action._choices_actions)
    own = command._action_groups[:2]  # what is in no group of the command's own
    for group in command._action_groups:
        hidden = argparse._SubParsersAction | argparse._HelpAction
        actions = [action for action in group._group_actions if not isinstance(action, hidden)]
        if not actions:
            continue
        if group not in own and group.title:
            yield from ("", f"**{group.title.capitalize()}**")
        yield from ("", "| argument | meaning |", "| --- | --- |")
        yield from (f"| {spelled(action)} | {cell(action.help and action.help % vars(action))} |" for action in actions)
    if command.epilog:
        yield from ("", "```text", *command.epilog.splitlines(), "```")


def usage(command: argparse.ArgumentParser) -> list[str]:
    """Return the usage of a command, positional arguments last; argparse's own depends on the version of Python."""
    grouped = {id(action): group for group in command._mutually_exclusive_groups for action in group._group_actions}
    pieces: dict[int, str] = {}
    for action in sorted(command._actions, key=lambda action: not action.option_strings):
        if isinstance(action, argparse._HelpAction):
            continue
        group = grouped.get(id(action))
        if group is None:
            pieces[id(action)] = piece(action)
        else:
            either = " | ".join(short(each) for each in group._group_actions)
            pieces[id(group)] = f"({either})" if group.required else f"[{either}]"
    unbroken = " ".join(text.replace(" ", "\0") for text in pieces.values())
    indent = " " * (len(command.prog) + 1)
    lines = textwrap.wrap(
        f"{command.prog} {unbroken}",
        WIDTH,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\0", " ") for line in lines]


def piece(action: argparse.Action) -> str:
    """Write an argument as in a usage line."""
    return f"[{short(action)}]" if action.option_strings and not action.required else short(action)


def short(action: argparse.Action) -> str:
    """Write an argument with its value, by its last name."""
    return f"{action.option_strings[-1]} {value(action)}".strip() if action.option_strings else value(action)


def value(action: argparse.Action) -> str:
    """Return the placeholder for an argument's value."""
    if action.nargs == 0:
        return ""
    if isinstance(action, argparse._SubParsersAction):
        return str(action.metavar or "COMMAND") + " ..."
    choices = f"{{{','.join(map(str, action.choices))}}}" if action.choices else ""
    name = action.metavar or choices or (action.dest.upper() if action.option_strings else action.dest)
    form = PLACEHOLDERS.get(str(action.nargs), "{}")
    return form.format(name, name)


def spelled(action: argparse.Action) -> str:
    """Write an argument with all its names, as code in a cell."""
    names = [f"{name} {value(action)}".strip() for name in action.option_strings] or [value(action)]
    return ", ".join(f"`{name}`" for name in names).replace("|", r"\|")


def cell(text: str | None) -> str:
    """Write a help text in a cell of a table."""
    own = "print the version" if text == "show program's version number and exit" else text or ""
    return marked(own).replace("|", r"\|")


def marked(text: str) -> str:
    """Return a text with its options as code, so that they keep their two dashes."""
    return re.sub(r"(?<![\w`-])--[a-z][\w-]*", r"`\g<0>`", text)


if __name__ == "__main__":
    print(reference(), end="")
