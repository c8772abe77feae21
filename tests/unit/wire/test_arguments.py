"""Options of every command and part: which numbers they take."""

import argparse
import re
from collections.abc import Iterator

import pytest

from deltaswarm_agent.__main__ import parser as agent
from deltaswarm_board.__main__ import parser as board
from deltaswarm_cli.main import all_commands, parser
from deltaswarm_operator.__main__ import open_air_parser
from deltaswarm_operator.__main__ import parser as operator
from deltaswarm_world.__main__ import parser as world

MAY_BE_NEGATIVE = {"effect", "seed", "repeats", "prove"}
"""The last three are keys of files, and are checked with the others, so that all mistakes are told at once."""


def _options(made: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in made._actions:
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                yield from _options(sub)
        elif action.type is not None:
            yield action


def _taken(option: argparse.Action, text: str) -> object:
    """What an option makes of a text; None if it refuses it."""
    kind = option.type
    assert callable(kind)
    try:
        return kind(text)
    except (argparse.ArgumentTypeError, ValueError):
        return None


def _is_numeric(option: argparse.Action) -> bool:
    found = (_taken(option, text) for text in ("0.5", "1", "20"))
    return any(isinstance(one[0] if isinstance(one, list) and one else one, int | float) for one in found)


def test_numeric_options_take_only_finite_numbers_that_make_sense() -> None:
    """Of every command and part; neither are negative numbers taken where none makes sense, nor huge ones."""
    parsers = [parser(*all_commands()), agent(), board(), operator(), open_air_parser(), world()]
    numeric = [option for made in parsers for option in _options(made) if _is_numeric(option)]
    assert len(numeric) > 40
    for option in numeric:
        for text in ("nan", "inf", "-inf", "1e400", "1" * 5000, *([] if option.dest in MAY_BE_NEGATIVE else ["-1"])):
            assert _taken(option, text) is None, (option.dest, text[:10])


def test_a_refused_number_is_named_with_what_is_taken(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parser("branch").parse_args(["branch", "run", "--at", "inf"])
    assert re.search(r"--at: must be a number from 0 to 1000000000 \(got 'inf'\)", capsys.readouterr().err)
