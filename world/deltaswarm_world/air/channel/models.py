"""The models of the air, in the order in which a frame meets them."""

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
"""A new model is one line here; its place says which reason a frame gets that several models would cut."""


def pieces_of(context: Context) -> list[Piece]:
    """Build what is on; what is off costs nothing."""
    return [piece for model in MODELS if (piece := model.of(context)) is not None]
