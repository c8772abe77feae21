"""Build command lines: for the shell, for processes, and for advice to the user."""

import shlex
from argparse import Namespace
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any


def command_line(*words: object) -> str:
    """Return a command line of `deltaswarm` as a shell takes it."""
    return shlex.join(["deltaswarm", *map(_word, words)])


def as_given(arguments: Namespace, *, without: Collection[str] = ()) -> str:
    return command_line(*(word for word in getattr(arguments, "given", ()) if word not in without))


def options_given(arguments: Namespace, names: Iterable[str]) -> list[str]:
    """Return the options among `names` that were given, as words of a command line."""
    return option_words({f"--{name.replace('_', '-')}": getattr(arguments, name) for name in names})


def option_words(options: Mapping[str, Any]) -> list[str]:
    """Return options as words: a flag if True, else `--name=value`, and one word for each item of a list."""
    words = []
    for option, value in options.items():
        for one in value if isinstance(value, list) else [value]:
            if one is True:
                words.append(option)
            elif one is not None and one is not False:
                words.append(f"{option}={'='.join(one) if isinstance(one, tuple) else one}")
    return words


def _word(word: object) -> str:
    """Return a word; a path that begins with a dash would be taken for an option."""
    return f"./{word}" if isinstance(word, Path) and str(word).startswith("-") else str(word)
