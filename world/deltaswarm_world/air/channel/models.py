"""The radio models, in the order in which they apply to a frame."""

from deltaswarm_world.air.channel.asymmetry import Asymmetry
from deltaswarm_world.air.channel.chance import Bursts, Contention, Loss
from deltaswarm_world.air.channel.links import Piece
from deltaswarm_world.air.channel.model import Context, Model
from deltaswarm_world.air.channel.obstacles import RadioObstacles
from deltaswarm_world.air.channel.zones import Blackouts, Jammers, Walls

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


def pieces_of(context: Context) -> list[Piece]:
    """Build the models that are on."""
    return [piece for model in MODELS if (piece := model.of(context)) is not None]
