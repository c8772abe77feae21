"""Commands for tests: strategies for what travels, swarms that are commanded, agents that hear commands by hand."""

import pickle
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from hypothesis import strategies as st

from deltaswarm_operator.core.console import Console
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_wire import commands as wire
from deltaswarm_wire import operator_messages as om
from deltaswarm_wire.checked import load
from deltaswarm_wire.codec import MAX_ABS_CM, MAX_ABS_M, MAX_ID, MAX_STEP
from deltaswarm_wire.commands import ArgumentForm, Command, CommandForm, Relayed, Signed, Target, encode_command
from tests.support import strategies

Kept = TypeVar("Kept")
words = st.text(st.characters(categories=["L", "N", "P"], max_codepoint=0x24F), min_size=1, max_size=8)
values = st.integers(-MAX_ID, MAX_ID) | st.floats(-1e12, 1e12) | words
targets = st.one_of(
    st.just(Target()),
    st.builds(lambda *xyr: Target(wire.CIRCLE, xyr), strategies.metres, strategies.metres, st.floats(0, MAX_ABS_M)),
    st.builds(lambda root: Target(wire.TREE, (float(root),)), st.integers(0, wire.BASE_ID - 1)),
    st.builds(lambda agent: Target(wire.AGENT, (float(agent),)), st.integers(0, wire.BASE_ID - 1)),
    st.builds(lambda *xy: Target(wire.PLACE, xy), strategies.metres, strategies.metres),
)
commands = st.builds(
    Command, strategies.ids, words, targets, st.dictionaries(words, values, max_size=4), st.floats(0.0, wire.MAX_LIFE_S)
)
signed = st.builds(Signed, commands.map(encode_command), st.binary(max_size=wire.MAX_SIGNATURE_BYTES))
relayed = st.builds(Relayed, strategies.steps, signed)
turns = st.builds(wire.Turn, st.integers(-1, MAX_STEP), strategies.tuples_of(signed, 4))
paces = st.builds(wire.Pace, st.floats(0.0, 1e4), st.integers(-1, MAX_STEP + 1))
members = st.builds(
    om.ReportedMember,
    strategies.agents,
    strategies.agents,
    st.integers(-MAX_ABS_CM, MAX_ABS_CM),
    st.integers(-MAX_ABS_CM, MAX_ABS_CM),
)
answers = st.builds(om.Answer, strategies.ids, st.sampled_from([om.HEARD, om.DONE, om.REFUSED]))
full_reports = st.builds(
    lambda report, named, told: report._replace(members=named, answers=told),
    strategies.reports,
    strategies.tuples_of(members, 5),
    strategies.tuples_of(answers, 4),
)
relaying = st.builds(
    strategies.envelope.Sample,
    strategies.ids,
    st.none(),
    st.lists(st.binary(max_size=20), min_size=1, max_size=8).map(tuple),
)

COMMAND = strategies.Codec(
    "command",
    commands,
    encode_command,
    wire.decode_command,
    {"number": 1, "name": 2, "target": 3, "arguments": 4, "life_s": 5},
)
RELAYED = strategies.Codec(
    "relayed", relayed, wire.encode_relayed, wire.decode_relayed, {"left_steps": 0, "command": 1}
)
TURN = strategies.Codec("turn", turns, wire.encode_turn, wire.decode_turn, {"step": "step", "commands": "commands"})
PACE = strategies.Codec("pace", paces, wire.encode_pace, wire.decode_pace, {"speed": "speed", "hold_step": "hold_step"})
REPORT = strategies.Codec(
    "report", full_reports, om.encode_report, om.decode_report, {name: name for name in om.Report._fields}
)
RELAYING = strategies.Codec(
    "radio",
    relaying,
    strategies.envelope.encode_sample,
    strategies.envelope.decode_sample,
    {"counter": 1, "payload": 2, "commands": 3},
)
CODECS = (COMMAND, RELAYED, TURN, PACE, REPORT, RELAYING)

FORM = CommandForm(
    "test",
    tuple(wire.TARGET_NUMBERS),
    (
        ArgumentForm("whole", "integer", 1, 9),
        ArgumentForm("real", "number", -1.5, 2.5),
        ArgumentForm("word", "text"),
        ArgumentForm("pick", "choice", choices=("a", "b")),
    ),
)
RIGHT: Mapping[str, Any] = {"whole": 3, "real": 0.5, "word": "ä word", "pick": "a"}
EVERYBODY = Target()
GO = CommandForm("go", tuple(wire.TARGET_NUMBERS))


def a_command(number: int = 0, name: str = "go", target: Target = EVERYBODY, life_s: float = 20.0) -> Command:
    """One without arguments."""
    return Command(number, name, target, {}, life_s)


def sign(command: Command) -> Signed:
    """As it travels in an emulated run."""
    return Signed(encode_command(command))


def item(command: Command, left_steps: int = 20) -> bytes:
    """As it is relayed."""
    return wire.encode_relayed(Relayed(left_steps, sign(command)))


def briefing(*commands: Mapping[str, Any], **table: Any) -> Briefing:
    """What an operator is told, whose agents accept `GO` and `FORM`."""
    given: dict[str, Any] = {"title": "a test", "agents": 9, "command": list(commands), **table}
    made = load(Briefing, given)
    return Briefing(**{**vars(made), "forms": (GO, FORM)})


def script(*rows: Sequence[Any]) -> str:
    """The override of a scenario by commands: rows of time, name, target, its numbers, arguments, life."""
    made = []
    for at_s, name, target, numbers, arguments, *life_s in rows:
        told = ", ".join(f"{key} = {value}" for key, value in arguments.items())
        life = f", life_s = {life_s[0]}" if life_s else ""
        made.append(
            f'{{at_s = {at_s}, name = "{name}", target = "{target}", numbers = {list(numbers)}, '
            f"arguments = {{{told}}}{life}}}"
        )
    return f"command=[{', '.join(made)}]"


def reloaded(kept: Kept) -> Kept:
    """Read an object back from a checkpoint."""
    loaded: Kept = pickle.loads(pickle.dumps(kept))
    return loaded


def taken_over(console: Console, *, has_station: bool = False) -> Console:
    """The console of the operator that replaces a killed one."""
    other = reloaded(console)
    other.attend(has_station=has_station)
    other.resume()
    return other
