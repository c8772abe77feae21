"""Make environments: `deltaswarm.parallel_env` and `deltaswarm.env`."""

import inspect
from typing import TYPE_CHECKING, Any

from deltaswarm.arguments import COUNTS, fitted
from deltaswarm.errors import one_error
from deltaswarm_orchestrator.base.exits import CommandError

if TYPE_CHECKING:
    from pettingzoo import AECEnv

    from deltaswarm_learn.environment import SwarmEnv

EXTRA = ("gymnasium", "pettingzoo")


def parallel_env(*arguments: Any, **named: Any) -> "SwarmEnv":
    """Make a swarm's environment in which all agents act at once; the arguments are those of `SwarmEnv`.

    Raises:
        Error: arguments are wrong, or the extra `learn` is not installed.
    """
    with one_error("parallel_env"):
        try:
            from deltaswarm_learn.environment import SwarmEnv
        except ModuleNotFoundError as error:
            if str(error.name).partition(".")[0] not in EXTRA:
                raise
            raise CommandError(f"a learning environment needs {error.name}: pip install 'deltaswarm[learn]'") from None
        bound = fitted(inspect.signature(SwarmEnv), arguments, named, {"max_cycles": COUNTS})
        return SwarmEnv(*bound.args, **bound.kwargs)


def env(*arguments: Any, **named: Any) -> "AECEnv[str, Any, Any]":
    """Make the same environment in which agents act in turn (AEC), as `parallel_env` does."""
    parallel = parallel_env(*arguments, **named)
    from pettingzoo.utils import OrderEnforcingWrapper, parallel_to_aec

    return OrderEnforcingWrapper(parallel_to_aec(parallel))
