"""Make environments: `deltaswarm.parallel_env`, `deltaswarm.env` and `deltaswarm.vector_env`."""

import inspect
from typing import TYPE_CHECKING, Any

from deltaswarm.arguments import COUNTS, fitted
from deltaswarm.errors import one_error

if TYPE_CHECKING:
    from pettingzoo import AECEnv

    from deltaswarm_learn.batch import SwarmVectorEnv
    from deltaswarm_learn.environment import SwarmEnv


def parallel_env(*arguments: Any, **named: Any) -> "SwarmEnv":
    """Make a swarm's environment in which all agents act at once; the arguments are those of `SwarmEnv`.

    Raises:
        Error: arguments are wrong, or the extra `learn` is not installed.
    """
    with one_error("deltaswarm.parallel_env"):
        from deltaswarm_learn.environment import SwarmEnv

        bound = fitted(inspect.signature(SwarmEnv), arguments, named, {"max_cycles": COUNTS})
        return SwarmEnv(*bound.args, **bound.kwargs)


def env(*arguments: Any, **named: Any) -> "AECEnv[str, Any, Any]":
    """Make the same environment in which agents act in turn (AEC), as `parallel_env` does."""
    parallel = parallel_env(*arguments, **named)
    from pettingzoo.utils import OrderEnforcingWrapper, parallel_to_aec

    return OrderEnforcingWrapper(parallel_to_aec(parallel))


def vector_env(*arguments: Any, **named: Any) -> "SwarmVectorEnv":
    """Make many swarms' environment, whose arrays have a row per run; the arguments are those of `SwarmVectorEnv`.

    Raises:
        Error: arguments are wrong, or the extra `learn` or `fast` is not installed.
    """
    with one_error("deltaswarm.vector_env"):
        from deltaswarm_learn.batch import SwarmVectorEnv

        bound = fitted(inspect.signature(SwarmVectorEnv), arguments, named, {"runs": COUNTS, "max_cycles": COUNTS})
        return SwarmVectorEnv(*bound.args, **bound.kwargs)
