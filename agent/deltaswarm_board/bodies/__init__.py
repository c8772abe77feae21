"""The bodies of a board, and how the name in its file is resolved."""

from typing import Any, ClassVar

from deltaswarm_agent.body import Body, BodyContext
from deltaswarm_board.driver import checked_sensed
from deltaswarm_wire import checked
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.foreign import Foreign, called, name_of
from deltaswarm_wire.plugins import BODIES, find

SHIPPED = {
    "kinematic": "deltaswarm_board.bodies.kinematic:KinematicBody",
    "mavlink": "deltaswarm_board.bodies.mavlink:MavlinkBody",
}
"""This package's own bodies, which a board finds without a search through all packages."""


def find_body(kind: str, path: str = "body.kind") -> type[Body]:
    """Find the class that `kind` names: a shipped body, an entry point, or `module:Class`."""
    shipped = BODIES._replace(shipped=SHIPPED)
    body: type[Body] = find(shipped, kind, path, others=["world"])
    return body


def options_of(body: type[Body], table: dict[str, Any], path: str = "body.options") -> Any:
    """Check the body's own options."""
    name, passes = f"{name_of(body)}.Settings", (SettingsError,)
    return called(name, checked.load, body.Settings, table, path, at=body, passes=passes)


class ForeignBody(Foreign):
    CHECKS: ClassVar = {"sense": lambda _, value, time_s: checked_sensed(value)}


def make_body(body: type[Body], options: Any, context: BodyContext) -> Body:
    """Make a body of this class. Raises PluginError if a body from outside raises."""
    made: Body = ForeignBody.make(body, options, context)
    return made
