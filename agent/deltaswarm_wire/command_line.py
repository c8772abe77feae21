"""The argument parser of every command: no abbreviated options, and a hint for a misspelt option or command."""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Any

from deltaswarm_wire.checked import did_you_mean


class Parser(argparse.ArgumentParser):
    """Takes options by their full names only; unknown names are refused before anything else is checked."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.allow_abbrev = False

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Parse arguments; end with a usage error at the first unknown option or command."""
        args = sys.argv[1:] if args is None else args
        self._refuse_unknown(args)
        return super().parse_known_args(args, namespace)

    def _refuse_unknown(self, args: Sequence[str]) -> None:
        commands = next((a.choices for a in self._actions if isinstance(a, argparse._SubParsersAction)), None)
        before_command = args if commands is None else takewhile(lambda word: word.startswith("-"), args)
        for name in _long_options(before_command):
            if name not in self._option_string_actions:
                self._refuse("option", name, self._option_string_actions)
        command = next((word for word in args if not word.startswith("-")), None)
        if commands is not None and command is not None and command not in commands:
            self._refuse("command", command, commands)

    def _refuse(self, kind: str, name: str, known: Iterable[str]) -> None:
        hint = did_you_mean(name, [other for other in known if kind == "command" or other.startswith("--")])
        self.error(f"there is no {kind} {name!r}; {hint}see {self.prog} --help")


def _long_options(words: Iterable[str]) -> Iterator[str]:
    """Yield the names of the long options among the words of a command line."""
    for word in takewhile(lambda word: word not in ("--", "-h", "--help"), words):
        name = word.partition("=")[0]
        if word.startswith("--") and " " not in name:
            yield name
