"""What a plug-in's object raises and returns is checked where deltaswarm calls it, and its place is named."""

import pickle
from typing import Any, ClassVar

import pytest

from deltaswarm_wire.foreign import Foreign, is_foreign
from deltaswarm_wire.plugin_errors import PluginError
from tests.support.tiers import in_one_test


def _small(most: int, value: int, *arguments: int) -> int:
    if value > most:
        raise ValueError(f"must be at most {most} (got {value})")
    return 10 * value


class _ForeignNumbers(Foreign):
    CHECKS: ClassVar = {"of": _small, "least": _small}
    PASSES = (OSError,)


class _Numbers:
    least = 9
    other = 5

    def of(self, value: int) -> int:
        return value // (value - 3)

    def ends(self) -> None:
        raise SystemExit(0)

    def refuses(self) -> None:
        raise OSError("not here")


def numbers(**attributes: Any) -> Any:
    """An object with these attributes, whose numbers are at most 4."""
    plugin = _Numbers()
    vars(plugin).update(attributes)
    return _ForeignNumbers(plugin, 4)


def test_what_is_well_passes() -> None:
    for made in (numbers(least=2), pickle.loads(pickle.dumps(numbers(least=2)))):
        assert (made.least, made.of(4), made.other) == (20, 40, 5)
    with pytest.raises(OSError, match="not here"):
        numbers().refuses()


@in_one_test(
    ("call", "said"),
    [
        (lambda made: made.least, "_Numbers.least must be at most 4 (got 9)"),
        (lambda made: made.of(5), ""),
        (lambda made: made.of(3), "_Numbers.of failed: ZeroDivisionError"),
        (lambda made: made.of(), "_Numbers.of failed: TypeError"),
        (lambda made: made.ends(), "_Numbers.ends failed: SystemExit"),
        (lambda made: numbers(of=lambda value: [][value]).of(1), "_Numbers.of failed: IndexError"),
        (lambda made: made.nothing, "_Numbers.nothing failed: AttributeError"),
        (lambda made: numbers(of=lambda value: 7).of(1), "_Numbers.of must be at most 4 (got 7)"),
        (lambda made: numbers(of=lambda value: "x").of(1), "_Numbers.of failed: TypeError"),
        (lambda made: _ForeignNumbers.make(_Numbers, 1), "_Numbers failed: TypeError"),
    ],
)
def test_what_is_not_names_class_file_and_line(call: Any, said: str) -> None:
    if not said:
        assert call(numbers()) == 20
        return
    with pytest.raises(PluginError) as caught:
        call(numbers())
    text = str(caught.value)
    assert f"{__name__}:{said}" in text
    assert f"{__file__}:" in text
    assert "\n" not in text


def test_what_comes_with_deltaswarm_is_not_wrapped() -> None:
    assert not is_foreign(Foreign)
    assert type(Foreign.make(PluginError, "a text")) is PluginError
