"""Runs, sweeps and studies from Python, each by one function: `import deltaswarm`.

What is named here is loaded when it is asked for, because the command line is built on this package and starts fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from deltaswarm_wire import __version__ as __version__

if TYPE_CHECKING:
    from deltaswarm.errors import Error as Error
    from deltaswarm.runs import Run as Run
    from deltaswarm.runs import open as open
    from deltaswarm.runs import run as run
    from deltaswarm.sweeps import sweep as sweep
    from deltaswarm_learn.make import env as env
    from deltaswarm_learn.make import parallel_env as parallel_env
    from deltaswarm_learn.make import vector_env as vector_env
    from deltaswarm_studies.conducting import StudyResult as StudyResult
    from deltaswarm_studies.conducting import study as study

WHERE = {
    "Error": "deltaswarm.errors",
    "Run": "deltaswarm.runs",
    "env": "deltaswarm_learn.make",
    "open": "deltaswarm.runs",
    "parallel_env": "deltaswarm_learn.make",
    "run": "deltaswarm.runs",
    "StudyResult": "deltaswarm_studies.conducting",
    "study": "deltaswarm_studies.conducting",
    "sweep": "deltaswarm.sweeps",
    "vector_env": "deltaswarm_learn.make",
}
"""The module of each public name; a new name is a line here and an import above, for type checkers."""

__all__ = ["__version__", *WHERE]


def __getattr__(name: str) -> Any:
    if name not in WHERE:
        raise AttributeError(f"module 'deltaswarm' has no attribute {name!r}")
    try:
        value = getattr(import_module(WHERE[name]), name)
    except ModuleNotFoundError as error:
        from deltaswarm.errors import error_of

        if (told := error_of(error, f"deltaswarm.{name}")) is None:
            raise
        raise told from None
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *WHERE})
