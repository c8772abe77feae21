"""The messages by which commands travel: what is encoded is decoded, what is strange is refused, forms check."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.operator_links import CommandSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import commands as wire
from deltaswarm_wire.checked import check
from deltaswarm_wire.codec import WireError, pack
from deltaswarm_wire.commands import (
    AGENT,
    ALL,
    CIRCLE,
    PLACE,
    TREE,
    Command,
    Signed,
    Target,
    Turn,
    decode_command,
    decode_turn,
    encode_command,
    encode_turn,
    make_target,
)
from deltaswarm_wire.operator_messages import MAX_ANSWERS, MAX_MEMBERS, Answer, Report, ReportedMember, encode_report
from deltaswarm_wire.plugin_errors import PluginError
from tests.support import commanding
from tests.support.commanding import FORM, RIGHT, a_command, sign
from tests.support.strategies import Codec, complaint, repacked, strange
from tests.support.tiers import in_one_test

each = pytest.mark.parametrize("codec", commanding.CODECS, ids=str)


@each
@given(data=st.data())
def test_what_is_encoded_is_decoded(codec: Codec, data: st.DataObject) -> None:
    message = data.draw(codec.strategy)
    encoded = codec.encode(message)
    assert codec.decode(encoded) == message
    assert codec.encode(codec.decode(encoded)) == encoded


@each
@given(data=st.data())
def test_a_decoder_takes_a_message_or_complains(codec: Codec, data: st.DataObject) -> None:
    error = complaint(codec, data.draw(strange(codec)))
    assert error is None or len(str(error)) < 2500


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, None, "1", 2**63, [], {}])
@pytest.mark.parametrize("place", ["number", "name", "target", "arguments", "life_s"])
def test_no_field_of_a_command_takes_what_it_is_not(place: str, value: Any) -> None:
    data = encode_command(a_command())
    if (place, value) in (("name", "1"), ("arguments", {})):
        return
    with pytest.raises(WireError):
        decode_command(repacked(data, commanding.COMMAND.places[place], value))


@in_one_test(
    "raw",
    [
        [TREE, -1],
        [TREE, 1.5],
        [AGENT, wire.BASE_ID],
        [CIRCLE, 1, 2, -1],
        [CIRCLE, 1, 2],
        [PLACE, 1, math.nan],
        [ALL, 1],
        ["everyone"],
        [[ALL]],
        [],
        None,
    ],
)
def test_a_target_is_somebody_or_somewhere(raw: Any) -> None:
    with pytest.raises(WireError):
        make_target(raw)


@in_one_test(
    "command",
    [
        a_command(name="x" * 65),
        a_command(name="bell\a"),
        a_command(number=-1),
        a_command(life_s=wire.MAX_LIFE_S + 1),
        a_command(target=Target(TREE, (1.5,))),
        Command(0, "go", Target(), {"text": "x" * 65}, 1.0),
        Command(0, "go", Target(), {"big": 2**70}, 1.0),
        Command(0, "go", Target(), {"yes": True}, 1.0),
        Command(0, "go", Target(), {f"n{n}": n for n in range(wire.MAX_ARGUMENTS + 1)}, 1.0),
        Command(0, "go", Target(), {f"n{n}": "x" * 60 for n in range(wire.MAX_ARGUMENTS)}, 1.0),
        Command(0, "go", Target(), {"none": math.nan}, 1.0),
    ],
)
def test_what_nobody_could_decode_is_not_encoded(command: Command) -> None:
    with pytest.raises(WireError):
        encode_command(command)


def test_a_turn_has_so_many_commands_and_no_broken_one() -> None:
    many = tuple([sign(a_command(number)) for number in range(wire.MAX_IN_TURN)])
    assert decode_turn(encode_turn(Turn(3, many))).commands == many
    for bad in ((*many, many[0]), (Signed(b"broken"),), (Signed(b"x" * 301),), (Signed(many[0].body, b"x" * 65),)):
        with pytest.raises(WireError):
            decode_turn(encode_turn(Turn(3, bad)))


def test_the_largest_turn_fits_on_a_link() -> None:
    body = max(
        (encode_command(Command(2**32 - 1, "n" * 64, Target(), {"a": "x" * k}, 1.0)) for k in range(65)), key=len
    )
    encode_turn(Turn(2**32 - 1, (Signed(body, b"s" * 64),) * wire.MAX_IN_TURN))
    row = ReportedMember(65535, 65535, 2**31 - 1, -(2**31) + 1)
    report = Report(65535, 0, 0, "root", 0.5, 0.5, 0, (), (row,) * MAX_MEMBERS, (Answer(2**32 - 1, 2),) * MAX_ANSWERS)
    assert commanding.REPORT.decode(encode_report(report)) == report


@in_one_test(
    ("name", "value"),
    [
        *((name, value) for name in ("whole", "real") for value in (True, math.nan, math.inf, -math.inf, "3", None)),
        ("whole", 3.0),
        ("whole", 0),
        ("whole", 10),
        ("real", -1.6),
        ("real", 10**400),
        ("word", 3),
        ("word", "x" * 65),
        ("word", "bell\a"),
        ("pick", "c"),
        ("pick", ["a"]),
        ("pick", 0),
    ],
)
def test_a_form_refuses_a_wrong_argument(name: str, value: Any) -> None:
    assert FORM.problem(Target(), RIGHT) is None
    problem = FORM.problem(Target(), {**RIGHT, name: value})
    assert problem is not None
    assert name in problem
    assert len(problem) < 300


@in_one_test("arguments", [{}, {**RIGHT, "more": 1}, {"whole": 3}, [], None, "whole", {**RIGHT, 3: 3}])
def test_a_form_wants_just_its_arguments(arguments: Any) -> None:
    assert FORM.problem(Target(), arguments)


def test_a_form_refuses_other_targets() -> None:
    assert "tree" in (wire.CommandForm("recall", (TREE,)).problem(Target(), {}) or "")


@given(target=commanding.targets, agent=st.integers(0, 9), root=st.integers(-1, 9))
def test_a_target_covers_whom_it_names(target: Target, agent: int, root: int) -> None:
    """By number, by tree, by place; who is in no tree is in none that a command can name."""
    here = (1.0, 2.0)
    covers = target.covers(agent, here, root)
    match target.kind:
        case wire.TREE:
            assert covers == (target.numbers[0] == root)
            assert not target.covers(agent, here, -1)
        case wire.AGENT:
            assert covers == (target.numbers[0] == agent)
        case wire.CIRCLE:
            assert covers == (math.dist(here, target.numbers[:2]) <= target.numbers[2])
        case _:
            assert covers
    assert str(target)


@in_one_test(
    "table",
    [
        {"target": "tree"},
        {"target": "tree", "numbers": [1.5]},
        {"target": "circle", "numbers": [1, 2, -3]},
        {"arguments": {"a": 2**70}},
        {"arguments": {"a": [1]}},
        {"arguments": {"a": {"b": 1}}},
        {"arguments": {"a": True}},
        {"arguments": {"a": "x" * 65}},
        {"name": "x" * 65},
        {"life_s": 0},
        {"life_s": math.nan},
        {"at_s": -1},
    ],
)
def test_a_script_says_what_is_wrong_with_a_command(table: dict[str, Any]) -> None:
    made, problems = check(CommandSettings, {"name": "go", **table})
    assert made is None
    assert problems


def test_a_range_of_the_downlink_needs_a_base() -> None:
    assert check(Scenario, {"downlink": {"range_m": 5}})[1]
    assert not check(Scenario, {"downlink": {"range_m": 5, "base_m": [1, 1]}})[1]
    assert not check(Scenario, {"downlink": {"range_m": 5}, "uplink": {"base_m": [1, 1], "range_m": 9}})[1]


def test_a_frame_without_payload_relays_something() -> None:
    for raw in ((2, 0, None), (2, 0, None, ()), (2, 0, None, (b"",) * 9), (2, 0, b"x", (None,)), (2, 0, "x", (b"",))):
        with pytest.raises(WireError):
            commanding.RELAYING.decode(pack(raw))


@in_one_test("wrong", [3, ("gather",), "gather", property(lambda self: ())])
def test_what_a_controller_declares_must_be_commands(wrong: Any) -> None:
    kind = type("Own", (), {"Commands": wrong, "__module__": __name__})
    with pytest.raises(PluginError, match=rf"{__name__}:Own\.Commands must be a tuple of CommandForm"):
        wire.forms_of(kind)
    assert wire.forms_of(object) == ()
