"""The protocol's page: its examples are what the code sends, its numbers are the code's numbers.

`python -m tests.docs.test_protocol` writes examples and tables of records anew into the page.
"""

import re
from pathlib import Path

import pytest

from deltaswarm_agent.controllers.paper.controller import REPORTING_ROLES
from deltaswarm_agent.core import agent_core
from deltaswarm_agent.io import process
from deltaswarm_board import inbox
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire import access, codec, commands, envelope, keys, messages, operator_messages, session, settings
from deltaswarm_wire.commands import (
    Command,
    Pace,
    Relayed,
    Signed,
    Target,
    Turn,
    decode_command,
    decode_pace,
    decode_relayed,
    decode_turn,
    encode_command,
    encode_pace,
    encode_relayed,
    encode_turn,
)
from deltaswarm_wire.envelope import Sample
from deltaswarm_wire.keys import Keys
from deltaswarm_wire.messages import Act, Event, Frame, TreeStatus
from deltaswarm_wire.operator_messages import (
    CLOCK,
    DONE,
    STATUS,
    WORKLOAD,
    Answer,
    Clock,
    Health,
    Report,
    ReportedMember,
    Status,
    Workload,
    decode_clock,
    decode_health,
    decode_report,
    decode_status,
    decode_workload,
    encode_clock,
    encode_health,
    encode_report,
    encode_status,
    encode_workload,
)
from tests.support.annotating import Example, Page, Shape, assert_is_the_codes, message
from tests.support.tiers import in_one_test

SOURCES = (
    access,
    codec,
    commands,
    envelope,
    messages,
    operator_messages,
    session,
    settings,
    agent_core,
    inbox,
    process,
)

_EVENTS = Shape("events", Event._fields, "nested")
_SAMPLE = Sample(77, bytes.fromhex("93 03 cd 13 88 cd 10 68"))
_COMMAND = Command(5, "hold", Target("circle", (50.0, 48.0, 20.0)), {"for_s": 300.0}, 120.0)
_SIGNED = Signed(encode_command(_COMMAND))
_RELAYED = Relayed(95, _SIGNED)

EXAMPLES = {
    "frame": Example(
        Frame(
            *(12, 12.0, False, 50.25, 48.0),
            ((49.25, 48.0),),
            (Event(3, 52.5, 47.0),),
            ((9, envelope.encode_sample(_SAMPLE)),),
        ),
        messages.encode_frame,
        messages.decode_frame,
        message(
            "frame",
            ("version", *(name for name in Frame._fields if name not in ("bumped", "blocked"))),
            poses=Shape("poses", ("x_m", "y_m"), "flat"),
            events=_EVENTS,
            heard=Shape("heard", ("sender", "sample"), "flat"),
        ),
    ),
    "act": Example(
        Act(12, 0.0, -1.0, (3,), TreeStatus("attending"), 13),
        messages.encode_act,
        messages.decode_act,
        message("act", ("version", *Act._fields[:4], *TreeStatus._fields, "until"), observed=Shape("observed")),
    ),
    "radio": Example(
        _SAMPLE, envelope.encode_sample, envelope.decode_sample, message("radio", ("version", "counter", "payload"))
    ),
    "relay": Example(
        Sample(78, None, (encode_relayed(_RELAYED),)),
        envelope.encode_sample,
        envelope.decode_sample,
        message("relay", ("version", "counter", "payload", Shape("commands"))),
    ),
    "relayed": Example(
        _RELAYED, encode_relayed, decode_relayed, message("relayed", ("left_steps", "command", "signature"))
    ),
    "command": Example(
        _COMMAND,
        encode_command,
        decode_command,
        message(
            "command",
            ("version", *Command._fields),
            target=message("target", ("kind", "x_m", "y_m", "radius_m")),
            arguments=Shape("arguments"),
        ),
    ),
    "sent": Example(
        envelope.Sent(31.5, 50.25, 48.0),
        envelope.encode_sent,
        envelope.decode_sent,
        message("sent", envelope.Sent._fields),
    ),
    "report": Example(
        Report(
            *(4, 31, 12, "root", 50.25, 48.0, 2),
            (Event(3, 52.5, 47.0),),
            (ReportedMember(7, 4, 5200, 4650), ReportedMember(11, 7, 4810, 5100)),
            (Answer(5, DONE),),
            3,
        ),
        encode_report,
        decode_report,
        message(
            "report",
            Report._fields,
            events=_EVENTS,
            members=Shape("members", ReportedMember._fields, "flat"),
            answers=Shape("answers", Answer._fields, "flat"),
        ),
    ),
    "health": Example(Health("no battery"), encode_health, decode_health, message("health", Health._fields)),
    "clock": Example(Clock(12, 12.0, False), encode_clock, decode_clock, message("clock", Clock._fields)),
    "status": Example(
        Status(12, 9000, 12.0, 25, 11, 24.5, 2, 1, "running"),
        encode_status,
        decode_status,
        message("status", Status._fields),
    ),
    "workload": Example(
        Workload(12, 12.0, 4, 4, 4.0, 3.5, 0.0, 0, 0, 0),
        encode_workload,
        decode_workload,
        message("workload", Workload._fields),
    ),
    "turn": Example(
        Turn(12, (_SIGNED,)),
        encode_turn,
        decode_turn,
        message("turn", Turn._fields, commands=Shape("commands", Signed._fields, "nested")),
    ),
    "pace": Example(Pace(5.0, -1), encode_pace, decode_pace, message("pace", Pace._fields)),
}

RECORDS = {record.name: record for record in (CLOCK, STATUS, WORKLOAD)}

PAGE = Page(Path(__file__).parents[2] / "agent" / "PROTOCOL.md", EXAMPLES)


@in_one_test("name", EXAMPLES)
def test_an_example_is_what_the_code_sends(name: str) -> None:
    """Every byte of the page's example, with its annotation, is the code's, and decodes to what the page says."""
    PAGE.assert_shows(name)


def test_every_message_has_its_example() -> None:
    """Whatever crosses the fabric but the truth and its like, which are for the recorder."""
    PAGE.assert_shows_no_other()


@pytest.mark.parametrize("name", RECORDS)
def test_a_table_of_a_record_is_the_codes(name: str) -> None:
    """Every field with its type, limits and meaning."""
    assert f"<!-- record {name} -->\n\n{RECORDS[name].table()}\n\n" in PAGE.text


@in_one_test(("name", "number"), PAGE.constants())
def test_a_number_of_the_page_is_the_codes(name: str, number: str) -> None:
    """Each row of a table that begins with a constant's name gives that constant."""
    assert_is_the_codes(name, number, SOURCES)


def test_the_page_names_all_limits_of_what_travels() -> None:
    """Of the envelope, the messages, the commands, and the attachment in open air."""
    named = {name for name, _ in PAGE.constants()}
    sources = (envelope, messages, operator_messages, commands)
    limits = {name for source in sources for name in vars(source) if name.startswith("MAX_")} - {"MAX_ABS_CM"}
    assert {*limits, "MAX_SENT_BYTES", "FORGET_SENDER_S", "PROTOCOL_VERSION", "BASE_ID"} <= named


def test_keys_and_names_of_the_page_are_the_codes() -> None:
    """For a run called `demo` and agent 7."""
    text, demo = PAGE.text, Keys("demo")
    leaves = (keys.FRAME, keys.RADIO, keys.REPORT, keys.ACT)
    for key in (*(demo.agent(7, leaf) for leaf in leaves), demo.token(keys.AGENT, 7), demo.token(keys.WORLD)):
        assert f"`{key}`" in text
    assert f"`{keys.HEALTH}`" in text
    for key in (demo.clock, demo.truth, demo.status, demo.workload, demo.orders, demo.done, demo.turn, demo.pace):
        assert f"`{key.removeprefix(demo.root + '/')}`" in text
    assert f"`{access.user_name(keys.AGENT, 7)}`" in text
    for name in ("Frame", "Radio", "Report", "Act"):
        assert f"`application/msgpack;deltaswarm.{name}.v1`" in text


def reporting_roles(*overrides: str) -> set[str]:
    """The roles in which a swarm reports within 300 steps."""
    scenario = load_scenario("smoke", [*overrides, "events.rate_hz=0.3"])
    swarm, roles = InProcess(scenario), set[str]()
    for _ in swarm.steps(299):
        roles |= {report.role for report in swarm.operator.reports_of_closed_step}
    return roles


def test_reports_have_the_roles_of_the_page() -> None:
    """One closed list: of the page, of the code, and of what swarms send; each role occurs."""
    listed = re.findall(
        r"^\| `(\w+)` \| ", PAGE.text.partition("### Report: ")[2].partition("Two more fields")[0], re.M
    )
    assert tuple(listed) == REPORTING_ROLES
    modes = ("decentralised", "hierarchical", "hybrid", "adaptive")
    assert set().union(*(reporting_roles(f"control.mode={mode}") for mode in modes)) == set(REPORTING_ROLES)


if __name__ == "__main__":
    text = PAGE.text
    for name in EXAMPLES:
        example = rf"```hexdump {name}\n.*?\n```\n\nIt decodes to `.*?`\.\n"
        text = re.sub(example, lambda _, name=name: PAGE.example(name), text, flags=re.DOTALL)
    for name, record in RECORDS.items():
        table = rf"(<!-- record {name} -->\n\n)(\|[^\n]*\n)+"
        text = re.sub(table, lambda found, record=record: f"{found[1]}{record.table()}\n", text)
    PAGE.path.write_text(text)
