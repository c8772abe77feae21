"""Where runs are done: on this machine, or by the engine of an installed package."""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, ClassVar

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.foreign import Foreign
from deltaswarm_wire.plugins import ENGINES, find

if TYPE_CHECKING:
    from deltaswarm_orchestrator.processes.elsewhere import RunEngine

LOCAL = "local"
"""This machine."""


def _has(*members: str) -> Callable[..., Any]:
    """Return a check that a value has members."""

    def check(_: None, value: Any, *arguments: Any) -> Any:
        if missing := [member for member in members if not hasattr(value, member)]:
            raise ValueError(f"must return an object with {', '.join(missing)} (got {value!r:.80})")
        return value

    return check


class ForeignPlacement(Foreign):
    """The places of a run's agents, of an engine from outside."""

    PASSES = (CommandError,)
    CHECKS: ClassVar = {
        "workers": _has("items"),
        "agents": _has("listen", "parts", "agents", "write_worlds", "start", "look", "end"),
    }


@contextmanager
def _placed(placed: Any) -> Iterator[ForeignPlacement]:
    with placed as placement:
        yield ForeignPlacement(placement)


class ForeignEngine(Foreign):
    """An engine from outside."""

    PASSES = (CommandError, SettingsError)
    CHECKS: ClassVar = {
        "placed": lambda _, value, *arguments: _placed(_has("__enter__", "__exit__")(_, value)),
        "sweep_engine": _has("run"),
    }


def engine_of(
    name: str, scheduler: str | None, listen: str = "", *, path: str = "--engine", local: Collection[str] = (LOCAL,)
) -> "RunEngine | None":
    """Return the engine of this name; None for this machine, which the names in `local` mean.

    `path` says where the name was given, for messages.

    Raises:
        SettingsError: there is no such engine.
        CommandError: something that it needs is not installed.
    """
    if name in local:
        return None
    engine: RunEngine = ForeignEngine.make(find(ENGINES, name, path, others=local), scheduler, listen)
    return engine
