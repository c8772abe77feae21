"""The directive `command-line`: what a parser of the command line takes, from the parser itself.

Its argument is where the parser comes from, as `module:function` or `module:function:COMMAND:...`.
"""

import argparse
import importlib
import re
from collections.abc import Iterator

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx


class CommandLine(Directive):
    """Usage, description and options of one command, with a link target for each option."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Write the command as MyST and parse that."""
        module, function, *commands = self.arguments[0].split(":")
        parser = getattr(importlib.import_module(module), function)(*commands[:1])
        for command in commands:
            parser = subparsers(parser)[command]
        parser.formatter_class = wide
        container = nodes.container()
        self.state.nested_parse(StringList(list(described(parser)), self.arguments[0]), 0, container)
        return container.children


def wide(prog: str) -> argparse.HelpFormatter:
    """A formatter that does not depend on the terminal."""
    return argparse.HelpFormatter(prog, width=100)


def subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of a parser's commands, by name."""
    return next(action.choices for action in parser._actions if isinstance(action, argparse._SubParsersAction))


def described(parser: argparse.ArgumentParser) -> Iterator[str]:
    """The lines of a page about a parser."""
    if parser.description:
        yield from (parser.description, "")
    prefix = "usage: "
    usage = [line[len(prefix) :] for line in parser.format_usage().splitlines()]
    yield from ("```text", *usage, "```", "")
    yield from (f"```{{program}} {parser.prog}", "```", "")
    own = parser._action_groups[:2]  # what is in no group of the command's own
    for group in parser._action_groups:
        if group not in own and group.title:
            yield from (f"**{group.title.capitalize()}**", "")
        for action in group._group_actions:
            yield from described_action(action)
    if parser.epilog:
        yield from ("```text", *parser.epilog.splitlines(), "```", "")


def described_action(action: argparse.Action) -> Iterator[str]:
    """The lines about an argument, or about each subcommand."""
    if isinstance(action, argparse._SubParsersAction):
        for choice in action._choices_actions:
            yield f"- `{choice.dest}`: {marked(choice.help or '')}"
        yield ""
    elif not isinstance(action, argparse._HelpAction):
        yield from (f"````{{option}} {', '.join(signatures(action))}", meaning(action), "````", "")


def signatures(action: argparse.Action) -> list[str]:
    """How an argument is written, once for each of its names."""
    values = f"{{{','.join(map(str, action.choices))}}}" if action.choices else action.dest.upper()
    value = "" if action.nargs == 0 else action.metavar or values
    return [f"{name} {value}".strip() for name in action.option_strings] or [str(value)]


def meaning(action: argparse.Action) -> str:
    """What the help says of an argument."""
    return marked((action.help or "").replace("%%", "%"))


def marked(text: str) -> str:
    """A text with its options as code, so that they keep their two dashes."""
    return re.sub(r"(?<![\w`-])--[a-z][\w-]*", r"`\g<0>`", text)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("command-line", CommandLine)
    return {"parallel_read_safe": True}
