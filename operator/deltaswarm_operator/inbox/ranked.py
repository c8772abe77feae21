"""The policy `ranked`: as `all`, with the most severe items first, and among them the oldest."""

from deltaswarm_operator.inbox.all import All
from deltaswarm_operator.inbox.policy import RANKED


class Ranked(All):
    """Shows everything, ranked by severity and age."""

    ORDER = RANKED
