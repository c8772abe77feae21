"""Where runs are done: on this machine, or by the engine of an installed package."""

from collections.abc import Collection
from typing import TYPE_CHECKING

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.plugins import ENGINES, find

if TYPE_CHECKING:
    from deltaswarm_orchestrator.processes.elsewhere import RunEngine

LOCAL = "local"
"""This machine."""


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
    engine: RunEngine = find(ENGINES, name, path, others=local)(scheduler, listen)
    return engine
