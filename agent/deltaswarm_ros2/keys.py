"""Keys, liveliness tokens and attachments of ROS 2's topics on Zenoh, as rmw_zenoh and zenoh-plugin-ros2dds use them.

`rmw_zenoh` is a ROS 2 middleware on Zenoh, `ros2dds` a bridge from DDS. Both send messages as CDR.
"""

import re
import struct
from typing import NamedTuple

from deltaswarm_ros2.definitions import HASHES

RMW_ZENOH, ROS2DDS = "rmw_zenoh", "ros2dds"
LAYOUTS = (RMW_ZENOH, ROS2DDS)

NODE, PUBLISHER, SUBSCRIPTION = "NN", "MP", "MS"
"""Kinds of entities that have a liveliness token."""

QOS = "::,10:,:,:,,"
"""Reliable, volatile, keep the last 10 (rclcpp's defaults): what differs from rmw_zenoh's own defaults is written."""

_TOKENS = "@ros2_lv"
_NONE = "%"
_TOKEN_PARTS = 13
_COUNT_AND_TIME = struct.Struct("<qq")
GID_BYTES = 16
_GID_LENGTH = bytes([GID_BYTES])

MAX_DOMAIN = 232
_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
NAME_RULE = "must be words of letters, digits and _ with / between, none beginning with a digit"


class AttachmentError(ValueError):
    """An attachment that is not rmw_zenoh's."""


class Attachment(NamedTuple):
    """What rmw_zenoh attaches to a message: its number from 1 on, the wall clock [Unix ns], the publisher's id."""

    number: int
    time_ns: int
    gid: bytes


class Node(NamedTuple):
    """A node of the ROS graph: its domain, its Zenoh session's id, its namespace ("" or "/robot7") and name."""

    domain: int
    session: str
    namespace: str
    name: str


class Endpoint(NamedTuple):
    """A publisher or subscription of the ROS graph: its session's id, kind, node, topic, and type as in its key."""

    session: str
    kind: str
    node: str
    topic: str
    type_key: str


def is_name(text: str) -> bool:
    return _NAME.fullmatch(text) is not None


def full_name(topic: str, namespace: str) -> str:
    """Resolve a topic's name as ROS does: a relative one is in the namespace ("" or "/robot7")."""
    return topic if topic.startswith("/") else f"{namespace}/{topic}"


def _type_key(message_type: str) -> str:
    """Name a type as DDS does, `geometry_msgs::msg::dds_::Twist_`, and its hash: messages need both to arrive."""
    package, _, name = message_type.partition("/msg/")
    return f"{package}::msg::dds_::{name}_/{HASHES[message_type]}"


def _short(type_key: str) -> str:
    """Shorten a type's hash to 13 digits; Humble's `TypeHashNotSupported` is as long."""
    name, _, type_hash = type_key.partition("/")
    return f"{name}/{type_hash[:20]}"


def topic_key(layout: str, domain: int, topic: str, message_type: str) -> str:
    name = topic.removeprefix("/")
    return f"{domain}/{name}/{_type_key(message_type)}" if layout == RMW_ZENOH else name


def node_token(node: Node) -> str:
    """Make rmw_zenoh's liveliness token of a node, which is the first of its session."""
    return _token(node, 0, NODE)


def endpoint_token(node: Node, number: int, kind: str, topic: str, message_type: str) -> str:
    """Make rmw_zenoh's liveliness token of a publisher or subscription; `number` is unique in the session."""
    return "/".join((_token(node, number, kind), _mangled(topic), _type_key(message_type), QOS))


def all_tokens(domain: int) -> str:
    """Make the key expression of all tokens of a domain."""
    return f"{_TOKENS}/{domain}/**"


def parse_endpoint(token: str) -> Endpoint | None:
    """Parse the token of a publisher or subscription; None for any other."""
    parts = token.split("/")
    if len(parts) != _TOKEN_PARTS or parts[5] not in (PUBLISHER, SUBSCRIPTION):
        return None
    namespace, topic = (parts[at].replace(_NONE, "/") for at in (7, 9))
    return Endpoint(parts[2], parts[5], f"{namespace.rstrip('/')}/{parts[8]}", topic, "/".join(parts[10:12]))


def _token(node: Node, number: int, kind: str) -> str:
    parts = (_TOKENS, node.domain, node.session, 0, number, kind, _NONE, _mangled(node.namespace) or _NONE, node.name)
    return "/".join(map(str, parts))


def _mangled(name: str) -> str:
    return name.replace("/", _NONE)


def gid_of(token: str) -> bytes:
    """Derive a publisher's id from its token: 16 bytes that no other publisher has."""
    import hashlib

    return hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()


def encode_attachment(attachment: Attachment) -> bytes:
    return _COUNT_AND_TIME.pack(attachment.number, attachment.time_ns) + _GID_LENGTH + attachment.gid


def decode_attachment(data: bytes) -> Attachment:
    """Decode an attachment, also of a version that leaves out the length of the publisher's id."""
    head, length, gid = data[: _COUNT_AND_TIME.size], data[_COUNT_AND_TIME.size : -GID_BYTES], data[-GID_BYTES:]
    if len(data) < _COUNT_AND_TIME.size + GID_BYTES or length not in (b"", _GID_LENGTH):
        raise AttachmentError(f"an attachment must have 33 bytes, or 32 without a length (got {data[:40].hex(' ')})")
    number, time_ns = _COUNT_AND_TIME.unpack(head)
    return Attachment(number, time_ns, gid)


class Graph:
    """The endpoints of these topics, by their liveliness tokens. One thread may change it while another asks."""

    def __init__(self, *topics: str) -> None:
        self._topics = topics
        self._endpoints: dict[str, Endpoint] = {}

    def add(self, token: str) -> None:
        endpoint = parse_endpoint(token)
        if endpoint is not None and endpoint.topic in self._topics:
            self._endpoints[token] = endpoint

    def remove(self, token: str) -> None:
        self._endpoints.pop(token, None)

    def mismatch(self, session: str, kind: str, topic: str, message_type: str) -> str:
        """Why nobody of another session matches an endpoint that expects this kind at the other end; "" if one does."""
        types = {found.type_key for found in self._others(session, kind, topic)}
        if _type_key(message_type) in types:
            return ""
        verb = "published" if kind == PUBLISHER else "subscribed to"
        if types:
            told = ", ".join(map(_short, sorted(types)))
            return f"{topic} is {verb} as {told} and not as {_short(_type_key(message_type))}"
        return f"{topic} is not {verb}"

    def nodes(self, session: str, kind: str, topic: str) -> list[str]:
        """Return the nodes of other sessions that have an endpoint of this kind at a topic."""
        return sorted({found.node for found in self._others(session, kind, topic)})

    def _others(self, session: str, kind: str, topic: str) -> list[Endpoint]:
        found = list(self._endpoints.values())
        return [one for one in found if (one.kind, one.topic) == (kind, topic) and one.session != session]
