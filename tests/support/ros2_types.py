"""Another implementation of CDR for the same messages: the package rosbags, which has ROS 2's definitions.

A message is a dict, as in `deltaswarm_ros2.cdr`.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from deltaswarm_ros2.definitions import DEFINITIONS, fields_of

STORE = get_typestore(Stores.ROS2_JAZZY)


def _built(message_type: str, message: Mapping[str, Any]) -> Any:
    """An instance of rosbags' class, with those of its fields."""
    made: dict[str, Any] = {}
    for name, kind, length in fields_of(message_type):
        value = message[name]
        if kind in DEFINITIONS:
            made[name] = _built(kind, value) if length is None else [_built(kind, entry) for entry in value]
        else:
            made[name] = value if length is None else np.array(value, kind)
    return STORE.types[message_type](**made)


def bag_encoded(message_type: str, message: Mapping[str, Any]) -> bytes:
    """Encode by rosbags."""
    return bytes(STORE.serialize_cdr(_built(message_type, message), message_type))


def bag_decoded(message_type: str, data: bytes) -> dict[str, Any]:
    """Decode by rosbags."""
    return _plain(dataclasses.asdict(STORE.deserialize_cdr(data, message_type)))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        # Without rosbags' constants, in capitals, and its `__msgtype__`.
        return {name: _plain(entry) for name, entry in value.items() if name.islower() and name[0] != "_"}
    return tuple(map(_plain, value)) if isinstance(value, list | tuple | bytes | np.ndarray) else value
