"""The codec: limits, and checks that say which field was wrong."""

import contextlib
import math
import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_wire import codec
from deltaswarm_wire.codec import MAX_SAMPLE_BYTES, PROTOCOL_VERSION, WireError
from tests.support.strategies import NASTY, nested
from tests.support.tiers import in_one_test

NOT_NUMBERS = [None, True, False, "1", b"1", [], {}, math.nan, math.inf, -math.inf]


def refused(check: Callable[..., Any], *arguments: Any) -> WireError:
    with pytest.raises(WireError) as caught:
        check(*arguments)
    return caught.value


def test_a_sample_of_the_largest_size_passes_and_one_byte_more_does_not() -> None:
    largest = b"x" * (MAX_SAMPLE_BYTES - 3)
    data = codec.pack(largest)
    assert len(data) == MAX_SAMPLE_BYTES
    assert codec.unpack(data) == largest
    assert str(MAX_SAMPLE_BYTES) in str(refused(codec.pack, largest + b"x"))
    assert refused(codec.unpack, data + b"x").field == "sample"


IN_TWO_THREADS = """
import sys, threading
from deltaswarm_wire.codec import pack, unpack
sys.setswitchinterval(1e-6)
wrong = []
def encode(value):
    try:
        wrong.extend(value for _ in range(1500) if unpack(pack(value)) != value)
    except Exception as error:
        wrong.append(error)
threads = [threading.Thread(target=encode, args=[[number] * 40]) for number in (1, 70_000)]
for thread in threads: thread.start()
for thread in threads: thread.join()
print(sys.modules["msgpack"].Packer.__module__, len(wrong), wrong[:1])
"""


@pytest.mark.parametrize("pure", ["", "1"], ids=["compiled", "pure Python"])
def test_two_threads_may_encode(pure: str) -> None:
    """As on a board, one of whose threads watches the other; also where msgpack is not compiled, as on armv7."""
    environment = {**os.environ, "MSGPACK_PUREPYTHON": pure}
    command = [sys.executable, "-c", IN_TWO_THREADS]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["msgpack.fallback" if pure else "msgpack._cmsgpack", "0", "[]"]


@in_one_test(
    "data",
    [
        b"",
        b"\xc1",
        b"\x91",
        b"\x01\x01",
        b"\xa1\xff",
        b"\x81\x01\x01",
        b"\x81\x90\x01",
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\xc7\x0c\xff" + b"\xff" * 12,
        b"\xc7\x05\xff" + b"\xff" * 5,
        nested(5000),
    ],
)
def test_what_is_not_one_messagepack_value_is_refused_with_a_reason(data: bytes) -> None:
    error = refused(codec.unpack, data)
    assert error.field == "sample"
    assert "(got )" not in str(error)


@given(st.binary(max_size=200))
def test_random_bytes_never_raise_anything_else(data: bytes) -> None:
    with contextlib.suppress(WireError):
        codec.unpack(data)


@in_one_test("value", [*NOT_NUMBERS, 1.0, 1.5])
def test_an_integer_is_neither_bool_nor_float_nor_text(value: Any) -> None:
    assert refused(codec.integer, value, 0, 10, "m.f").field == "m.f"


@in_one_test("value", NOT_NUMBERS)
def test_a_number_is_finite_and_no_bool(value: Any) -> None:
    assert refused(codec.number, value, -10.0, 10.0, "m.f").field == "m.f"


def test_an_integer_may_stand_for_a_number() -> None:
    """Small encoders write 1 for 1.0; it comes out as float."""
    assert type(codec.number(1, 0.0, 2.0, "m.f")) is float


@given(st.integers(-(2**63), 2**64 - 1), st.integers(-5, 5), st.integers(-5, 5))
def test_bounds_are_inclusive(value: int, low: int, high: int) -> None:
    for check in (codec.integer, codec.number):
        if low <= value <= high:
            assert check(value, low, high, "m.f") == value
        else:
            assert str(value) in str(refused(check, value, low, high, "m.f"))


def test_a_string_is_bounded_and_one_of_those_allowed() -> None:
    assert codec.text("b", "m.f", allowed=("a", "b")) == "b"
    assert "a, b" in str(refused(codec.text, "c", "m.f", 9, ("b", "a")))
    assert "at most 3" in str(refused(codec.text, "long", "m.f", 3))
    assert refused(codec.text, b"a", "m.f").field == "m.f"


def test_arrays_have_their_length() -> None:
    assert codec.array([1, 2], 2, "m") == [1, 2]
    assert codec.arrays([1, 2], 2, "m") == [1, 2]
    assert "3 items (got 2)" in str(refused(codec.array, [1, 2], 3, "m"))
    assert "at most 1" in str(refused(codec.arrays, [1, 2], 1, "m"))
    for check in (codec.array, codec.arrays):
        assert "got tuple" in str(refused(check, (1, 2), 2, "m"))


def test_a_map_has_exactly_its_fields() -> None:
    assert codec.fields({"v": PROTOCOL_VERSION, "a": 2}, ("a",), "m") == {"v": PROTOCOL_VERSION, "a": 2}
    assert refused(codec.fields, {"v": PROTOCOL_VERSION}, ("a",), "m").field == "m.a"
    assert "b, c" in str(refused(codec.fields, {"v": PROTOCOL_VERSION, "a": 2, "c": 3, "b": 4}, ("a",), "m"))
    assert refused(codec.fields, {"a": 2}, ("a",), "m").field == "version"
    assert refused(codec.fields, [1], ("a",), "m").field == "m"


@in_one_test("value", [value for value in NASTY if type(value) is not int])
def test_any_other_version_is_refused(value: Any) -> None:
    for other in (value, float(PROTOCOL_VERSION), 0, 1, PROTOCOL_VERSION + 1):
        assert refused(codec.version, other).field == "version"


def test_a_deeply_nested_value_is_refused_as_any_other() -> None:
    """The error describes it by its type: to print it would overflow the interpreter's stack."""
    for depth in (10, 990, 1000, 1010, 1020):
        value: list[Any] = []
        for _ in range(depth):
            value = [value]
        assert "list" in str(refused(codec.version, value))
