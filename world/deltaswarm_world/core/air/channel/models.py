"""The radio models, in the order in which they apply to a frame."""

from deltaswarm_world.core.air.channel.asymmetry import Asymmetry
from deltaswarm_world.core.air.channel.chance import Bursts, Contention, Loss
from deltaswarm_world.core.air.channel.links import LinkModel
from deltaswarm_world.core.air.channel.model import Context, Model
from deltaswarm_world.core.air.channel.obstacles import RadioObstacles
from deltaswarm_world.core.air.channel.zones import Blackouts, Jammers, Walls

MODELS: tuple[type[Model], ...] = (
    Blackouts,
    Walls,
    RadioObstacles,
    Jammers,
    Asymmetry,
    Loss,
    Bursts,
    Contention,
)
"""A new model is one line here; the first model that cuts a frame gives the reason."""


def models_of(context: Context) -> list[LinkModel]:
    """Build the models that are on."""
    return [model for kind in MODELS if (model := kind.of(context)) is not None]
