"""Make environments: `deltaswarm.parallel_env` and `deltaswarm.env`."""

from typing import TYPE_CHECKING, Any

from deltaswarm_orchestrator.base.exits import CommandError

if TYPE_CHECKING:
    from pettingzoo import AECEnv

    from deltaswarm_learn.environment import SwarmEnv

INSTALL = "pip install 'deltaswarm[learn]'"

EXTRA = ("gymnasium", "pettingzoo")


def parallel_env(*arguments: Any, **named: Any) -> "SwarmEnv":
    """Make a swarm's environment in which all agents act at once; the arguments are those of `SwarmEnv`.

    Raises:
        CommandError: the extra `learn` is not installed.
        SettingsError: arguments are wrong.
    """
    try:
        from deltaswarm_learn.environment import SwarmEnv
    except ModuleNotFoundError as error:
        if error.name not in EXTRA:
            raise
        raise CommandError(f"a learning environment needs {error.name}: {INSTALL}") from None
    return SwarmEnv(*arguments, **named)


def env(*arguments: Any, **named: Any) -> "AECEnv[str, Any, Any]":
    """Make the same environment in which agents act in turn (AEC), as `parallel_env` does."""
    parallel = parallel_env(*arguments, **named)
    from pettingzoo.utils import OrderEnforcingWrapper, parallel_to_aec

    return OrderEnforcingWrapper(parallel_to_aec(parallel))
