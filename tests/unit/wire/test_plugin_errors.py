"""What a plug-in raises is told from what deltaswarm raises, and shown from the plug-in's own frame on."""

import importlib
import pickle
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_wire import plugin_errors
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.plugin_errors import PluginError, blamed, distinct, is_interrupt
from deltaswarm_wire.plugins import CONTROLLERS, RADIO_MODELS, find

PLUGIN = """
import json


def raises(error):
    raise error


def in_a_library(_):
    return json.loads("{")


def without_end(_):
    return without_end(_)


def chained(error):
    try:
        raise KeyError("first")
    except KeyError as first:
        raise error from first
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    (tmp_path / "own_plugin.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(plugin_errors, "_plugins", set())  # other tests load plug-ins from the package of tests
    find(RADIO_MODELS._replace(needed=()), "own_plugin:raises", "radio.models")
    yield importlib.import_module("own_plugin")
    sys.modules.pop("own_plugin", None)


def caught(call: Callable[[Any], object], error: BaseException | None = None) -> BaseException:
    try:
        call(error)
    except BaseException as raised:
        return raised
    raise AssertionError


ERRORS = [
    KeyError("x"),
    SettingsError([]),
    SystemExit(3),
    GeneratorExit(),
    StopIteration(),
    OSError(28, "No space left on device"),
    BrokenPipeError(32, "Broken pipe"),
    TimeoutError("late"),
    ConnectionError("gone"),
    MemoryError(),
    RuntimeError("can't start new thread"),
    KeyboardInterrupt(),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_whatever_a_plugin_raises_is_the_plugins(plugin: Any, error: BaseException) -> None:
    """Also what means bad input, a full disk, a limit or an interruption elsewhere."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        found = blamed(caught(plugin.raises, error))
    finally:
        signal.signal(signal.SIGINT, before)
    assert found is not None
    assert (found.kind, found.where) == (type(error).__name__, f"{plugin.__file__}:6")
    assert str(found).startswith("own_plugin:raises failed: ")


def test_what_no_plugin_raised_is_not_blamed_on_one(plugin: Any) -> None:
    def ours(_: object) -> None:
        raise OSError(28, "No space left on device")

    assert blamed(caught(ours)) is None


def test_a_signal_in_a_plugin_is_an_interruption(plugin: Any) -> None:
    """With Python's own handler, which leaves no frame."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert is_interrupt(caught(lambda _: plugin.raises(KeyboardInterrupt())))
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("name", "last", "where"),
    [
        ("raises", "ValueError: mine", 6),
        ("in_a_library", "json.decoder.JSONDecodeError", 10),
        ("without_end", "RecursionError", 14),
        ("chained", "ValueError: mine", 21),
    ],
)
def test_the_traceback_begins_with_the_plugins_frame(plugin: Any, name: str, last: str, where: int) -> None:
    error = blamed(caught(getattr(plugin, name), ValueError("mine")))
    assert error is not None
    lines = error.trace.splitlines()
    assert "deltaswarm_" not in error.trace
    assert lines[-1].startswith(last)
    assert len(lines) <= 61
    assert error.where == f"{plugin.__file__}:{where}"


def test_an_error_that_is_raised_again_shows_the_last_time_alone(plugin: Any) -> None:
    """An exception that is made once and raised by many agents would show the frames of all."""
    error = ValueError("mine")
    traces = []
    for _ in range(3):
        found = blamed(caught(plugin.raises, error))
        assert found is not None
        traces.append(found.trace)
    assert len(set(traces)) == 1


def test_equal_tracebacks_are_shown_once() -> None:
    frame = 'Traceback (most recent call last):\n  File "a.py", line 1, in step\n'
    traces = {"a": frame + "KeyError: 1", "b": frame + "KeyError: 2", "c": frame.replace("1,", "2,") + "KeyError: 1"}
    assert list(distinct(traces).values()) == [["a", "b"], ["c"]]


def test_it_survives_the_way_between_processes(plugin: Any) -> None:
    error = blamed(caught(plugin.raises, ValueError("mine")))
    assert error is not None
    assert pickle.loads(pickle.dumps(error)).report == error.report


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 / 0", "line 1, in <module>"),
        ("import sys\nsys.exit('usage: mine')", "SystemExit: usage: mine"),
        ("def (", "SyntaxError"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt"),
        ("import no_such_module_of_its_own", "ModuleNotFoundError"),
    ],
)
def test_a_module_that_raises_at_import_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, said: str
) -> None:
    (tmp_path / "broken_plugin.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with pytest.raises(SettingsError) as caught_error:
            find(CONTROLLERS, "broken_plugin:C", "control.mode")
    finally:
        signal.signal(signal.SIGINT, before)
    (problem,) = caught_error.value.problems
    assert said in problem.trace
    assert "importlib" not in problem.trace
    assert "broken_plugin.py" in problem.trace


def test_an_error_without_an_exception_is_its_text() -> None:
    error = PluginError("a text")
    assert (str(error), error.report, error.trace, error.where, error.kind) == ("a text", "a text", "", "", "")
