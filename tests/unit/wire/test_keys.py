"""Keys: one chunk for a run, one for an agent, and back."""

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_wire.codec import MAX_AGENT_ID
from deltaswarm_wire.keys import ACT, AGENT, FRAME, OPERATOR, RADIO, REPORT, WORLD, Keys, parse_agent_key, parse_token
from tests.support.strategies import agents
from tests.support.tiers import in_one_test

KEYS = Keys("run-1")

NO_NUMBERS = ["", "-1", "+1", "01", "007", "1.0", " 1", "1_0", "x", "*", "\u0663", "\u00b2", "65536", "9" * 5000]


@given(st.text(string.printable + "\u00e4\u0663", max_size=70))
def test_a_run_name_is_one_chunk_or_an_error(name: str) -> None:
    try:
        keys = Keys(name)
    except ValueError as error:
        assert "1 to 64 letters" in str(error)  # noqa: PT017 (either outcome is right)
    else:
        assert 1 <= len(name) <= 64
        assert not set(name) & set("/*$?#@ ")
        assert keys.root.split("/") == ["deltaswarm", name]


@in_one_test("name", ["", "a/b", "*", "**", "a*", "$*", "@lv", "a b", "-a", ".", "a\n", "\u00e4", "x" * 65])
def test_a_run_name_that_is_no_chunk_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="must be"):
        Keys(name)


@given(agents, st.sampled_from([FRAME, RADIO, REPORT, ACT]))
def test_an_agents_key_leads_back_to_it(agent: int, leaf: str) -> None:
    assert parse_agent_key(KEYS.agent(agent, leaf)) == (agent, leaf)


@given(agents, st.sampled_from([AGENT, OPERATOR, WORLD]))
def test_a_token_leads_back_to_its_process(number: int, role: str) -> None:
    assert parse_token(KEYS.token(role, number)) == (role, number)


@in_one_test("number", NO_NUMBERS)
def test_an_agents_number_is_spelled_in_one_way(number: str) -> None:
    """Plain digits without leading zeros, up to the largest id: no two keys stand for one agent."""
    assert parse_agent_key(f"deltaswarm/r/agent/{number}/act") is None
    assert parse_token(f"deltaswarm/r/@lv/agent/{number}") is None
    assert parse_agent_key(f"deltaswarm/r/agent/{MAX_AGENT_ID}/act") == (MAX_AGENT_ID, ACT)


@given(st.text(alphabet="/0129agentlv@rx*", max_size=40))
def test_any_other_key_is_none(key: str) -> None:
    parsed, token = parse_agent_key(key), parse_token(key)
    assert parsed is None or f"/agent/{parsed[0]}/" in key
    assert token is None or f"/@lv/{token[0]}/" in key


@in_one_test("key", ["", "agent/1/act", "x/agents/1/act", "x/agent/1", "x/agent/1/act/y"])
def test_a_key_of_another_form_is_none(key: str) -> None:
    assert parse_agent_key(key) is None
