"""Where runs are done: on this machine, or by the engine of an installed package."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, ClassVar

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.foreign import Foreign, name_of
from deltaswarm_wire.plugin_errors import PluginError, defined_at
from deltaswarm_wire.plugins import ENGINES, find

if TYPE_CHECKING:
    from deltaswarm_orchestrator.processes.elsewhere import RunEngine

LOCAL = "local"
"""This machine."""


def _with(value: Any, *members: str) -> Any:
    if missing := [member for member in members if not hasattr(value, member)]:
        raise ValueError(f"must return an object with {', '.join(missing)} (got {value!r:.80})")
    return value


class ForeignPlacement(Foreign):
    PASSES = (CommandError,)
    CHECKS: ClassVar = {
        "workers": lambda _, value: _with(value, "items"),
        "agents": lambda _, value, *arguments: _with(
            value, *("listen", "parts", "agents", "write_worlds", "start", "look", "end")
        ),
    }


@contextmanager
def _placed(kind: type[Any], value: Any, *arguments: Any) -> Iterator[ForeignPlacement]:
    with value as placement:
        if not (hasattr(placement, "workers") and hasattr(placement, "agents")):
            must = f"{name_of(kind)}.placed must yield a Placement, with workers and agents (got {placement!r:.80})"
            raise PluginError(f"{must} ({defined_at(kind)})")
        yield ForeignPlacement(placement)


def _runs(kind: type[Any], value: Any, tasks: Any) -> Iterator[Any]:
    try:
        for done in value:
            if not (hasattr(done, "task") and hasattr(done, "result")):
                raise PluginError(f"{name_of(kind)}: run must yield Done (got {done!r:.80}) ({defined_at(kind)})")
            yield done
    finally:
        getattr(value, "close", lambda: None)()  # abandons the other runs


class ForeignSweepEngine(Foreign):
    PASSES = (CommandError,)
    CHECKS: ClassVar = {"run": _runs}


class ForeignEngine(Foreign):
    """An engine from outside; its context is its class."""

    PASSES = (CommandError, SettingsError)
    CHECKS: ClassVar = {
        "placed": lambda kind, value, *arguments: _placed(kind, _with(value, "__enter__", "__exit__")),
        "sweep_engine": lambda kind, value, workers: ForeignSweepEngine(_with(value, "run"), kind),
    }


def engine_of(
    name: str, scheduler: str | None, listen: str = "", *, path: str = "--engine", local: Collection[str] = (LOCAL,)
) -> "RunEngine | None":
    """Return the engine of this name; None for this machine, which the names in `local` mean.

    `path` says where the name was given, for messages.

    Raises:
        SettingsError: there is no such engine.
        CommandError: something that it needs is not installed, or this machine has no use for a scheduler.
    """
    if name in local:
        if scheduler:
            raise CommandError("--scheduler is for --engine dask")
        return None
    kind = find(ENGINES, name, path, others=local)
    engine: RunEngine = ForeignEngine.make(kind, scheduler, listen, context=kind)
    return engine
