"""What the ROS graph says of a robot's topics: who publishes them, who subscribes to them, as which type."""

from deltaswarm_ros2.keys import PUBLISHER, Endpoint, dds_type, parse_endpoint


class Graph:
    """The endpoints of these topics, by their liveliness tokens. One thread may change it while another asks."""

    def __init__(self, *topics: str) -> None:
        self._topics = topics
        self._endpoints: dict[str, Endpoint] = {}

    def add(self, token: str) -> None:
        """Take a token that has appeared."""
        endpoint = parse_endpoint(token)
        if endpoint is not None and endpoint.topic in self._topics:
            self._endpoints[token] = endpoint

    def remove(self, token: str) -> None:
        """Take a token that has gone."""
        self._endpoints.pop(token, None)

    def mismatch(self, session: str, kind: str, topic: str, message_type: str) -> str:
        """Why nobody of another session matches an endpoint that expects this kind at the other end; "" if one does."""
        types = {found.dds_type for found in self._others(session, kind, topic)}
        if dds_type(message_type) in types:
            return ""
        verb = "published" if kind == PUBLISHER else "subscribed to"
        if types:
            return f"{topic} is {verb} as {', '.join(sorted(types))} and not as {message_type}"
        return f"{topic} is not {verb}"

    def nodes(self, session: str, kind: str, topic: str) -> list[str]:
        """Return the nodes of other sessions that have an endpoint of this kind at a topic."""
        return sorted({found.node for found in self._others(session, kind, topic)})

    def _others(self, session: str, kind: str, topic: str) -> list[Endpoint]:
        found = list(self._endpoints.values())
        return [one for one in found if (one.kind, one.topic) == (kind, topic) and one.session != session]
