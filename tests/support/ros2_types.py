"""Another implementation of CDR for the same messages: the package rosbags, which has ROS 2's definitions.

A message is a dict, as in `deltaswarm_ros2.cdr`.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from deltaswarm_ros2.definitions import DEFINITIONS, SEQUENCE, fields_of

STORE = get_typestore(Stores.ROS2_JAZZY)


def _array(value: Any, kind: str) -> Any:
    return np.array(value, kind) if isinstance(value, list | tuple) else value


def built(class_of: Callable[[str], Any], message_type: str, message: Mapping[str, Any], basic: Any = _array) -> Any:
    """An instance of another implementation's class, with those of its fields; `basic` converts basic values."""
    made: dict[str, Any] = {}
    for name, kind, length in fields_of(message_type):
        value = message[name]
        if kind not in DEFINITIONS:
            made[name] = basic(value, kind)
        elif length is None:
            made[name] = built(class_of, kind, value, basic)
        else:
            made[name] = [built(class_of, kind, entry, basic) for entry in value]
    return class_of(message_type)(**made)


def bag_encoded(message_type: str, message: Mapping[str, Any]) -> bytes:
    """Encode by rosbags."""
    return bytes(STORE.serialize_cdr(built(STORE.types.__getitem__, message_type, message), message_type))


def bag_decoded(message_type: str, data: bytes) -> dict[str, Any]:
    """Decode by rosbags."""
    return _plain(dataclasses.asdict(STORE.deserialize_cdr(data, message_type)))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        # Without rosbags' constants, in capitals, and its `__msgtype__`.
        return {name: _plain(entry) for name, entry in value.items() if name.islower() and name[0] != "_"}
    return tuple(map(_plain, value)) if isinstance(value, list | tuple | bytes | np.ndarray) else value


BASIC: Mapping[str, st.SearchStrategy[Any]] = {
    "int32": st.integers(-(2**31), 2**31 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "uint8": st.integers(0, 255),
    "byte": st.integers(0, 127),  # rosbags takes it as signed
    "bool": st.booleans(),
    "float32": st.floats(allow_nan=False, width=32),
    "float64": st.floats(allow_nan=False),
    "string": st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9),
}


def messages(message_type: str) -> st.SearchStrategy[Any]:
    """Any messages of a type."""
    made: dict[str, st.SearchStrategy[Any]] = {}
    for field in fields_of(message_type):
        one = BASIC[field.type] if field.type in BASIC else messages(field.type)
        if field.length is None:
            made[field.name] = one
        else:
            sizes = (0, 2) if field.length == SEQUENCE else (field.length, field.length)
            made[field.name] = st.lists(one, min_size=sizes[0], max_size=sizes[1]).map(tuple)
    return st.fixed_dictionaries(made)
