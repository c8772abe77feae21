"""How much of a table of cases is tested when: in one test, in the gate alone, or at length in the nightly tier."""

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any

import pytest


def nightly(*cases: object) -> list[object]:
    """Return cases of `parametrize` that only the nightly tier runs."""
    return [pytest.param(case, marks=pytest.mark.slow) for case in cases]


def first_of(cases: Iterable[object]) -> list[object]:
    """Return the first case for the gate, and the others for the nightly tier."""
    first, *others = cases
    return [first, *nightly(*others)]


def in_one_test(names: str | tuple[str, ...], cases: Iterable[Any]) -> Callable[..., Callable[..., None]]:
    """Run a test once for all cases of a table, as `parametrize` would run it for each; name every case that fails.

    It is for cases that need nothing of their own: each fixture is made once for all of them.
    """
    by_name = [{names: case} if isinstance(names, str) else dict(zip(names, case, strict=True)) for case in cases]
    assert by_name, "a table needs cases"

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def run(**fixtures: object) -> None:
            errors = []
            for case in by_name:
                try:
                    test(**case, **fixtures)
                except Exception as error:
                    error.add_note(f"with {', '.join(f'{name} = {value!r}' for name, value in case.items())}")
                    errors.append(error)
            if errors:
                raise ExceptionGroup(f"{len(errors)} of {len(by_name)} cases", errors)

        signature = inspect.signature(test)
        others = [parameter for name, parameter in signature.parameters.items() if name not in by_name[0]]
        run.__signature__ = signature.replace(parameters=others)  # type: ignore[attr-defined]
        return run

    return decorate
