"""An agent's part of a checkpoint: its full state in its own file."""

import pickle
from pathlib import Path

from deltaswarm_agent.controller import ControllerError
from deltaswarm_agent.core.agent_core import AgentCore
from deltaswarm_wire import checkpoint
from deltaswarm_wire.plugins import described


def saved(core: AgentCore, newest: int) -> bytes:
    """Pickle an agent with the step of its newest frame (-1 before the first).

    Raises:
        ControllerError: pickle cannot save the controller.
    """
    try:
        return checkpoint.pickled((core, newest))
    except Exception as error:  # a controller may be third-party code
        name = f"{type(core.controller).__module__}:{type(core.controller).__qualname__}"
        raise ControllerError(f"controller {name} cannot be saved in a checkpoint: {described(error)}") from error


def save(folder: Path, step: int, core: AgentCore, newest: int) -> None:
    """Write an agent's part of the checkpoint after a step. Raises ControllerError, OSError."""
    checkpoint.write(folder / str(step) / checkpoint.agent_file(core.agent), saved(core, newest))


def load(folder: Path, step: int, agent: int) -> tuple[AgentCore, int]:
    """Load an agent's state after a step, and the step of its newest frame.

    Raises:
        ControllerError: its file cannot be read.
    """
    file = folder / str(step) / checkpoint.agent_file(agent)
    try:
        core, newest = pickle.loads(file.read_bytes())
        return core, newest
    except Exception as error:  # the file, or a third-party controller, may raise anything
        raise ControllerError(f"{file} cannot be read: {described(error)}") from error
