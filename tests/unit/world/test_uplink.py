"""The uplink's models: what each does to reports, exact books, and the relay's hops."""

import tracemalloc
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.operator_links import LEAST_REPORT_BYTES
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import UPLINK_REASONS
from deltaswarm_wire.checked import load
from deltaswarm_wire.messages import Act, TreeStatus, encode_act
from deltaswarm_wire.operator_messages import Report, encode_report
from deltaswarm_world.core.air.radio import Air
from deltaswarm_world.core.uplink.relay import TIME_TO_LIVE_S
from deltaswarm_world.core.uplink.uplink import Uplink
from deltaswarm_world.core.world import WorldCore
from tests.support.airs import rates, shares, times

LINE_M = [[x, 0.0] for x in (0, 8, 16, 24, 32)]
"""Each agent hears its neighbours alone, at a radio range of 9 m."""

BASE = {"base_m": [0, 0], "range_m": 5.0}

STEPS_S = (0.5, 1.0)
"""Lengths of a step: what is set in seconds lasts as long with either."""


class Stage:
    """An uplink, driven by hand: everybody is there and reports, unless told otherwise."""

    def __init__(
        self, places_m: Sequence[Sequence[float]], uplink: dict[str, Any], step_s: float = 1.0, **radio: Any
    ) -> None:
        self.count = len(places_m)
        self.places_m = np.array(places_m, dtype=np.float64)
        self.step_s = step_s
        table = {"agents": {"count": self.count}, "uplink": uplink, "radio": {"range_m": 9.0, **radio}}
        scenario = load(Scenario, {"run": {"step_s": step_s}, **table})
        self.uplink = Uplink(scenario, Air(scenario).steady_links)
        self.step = -1

    def carry(
        self, senders: Sequence[int] = (), trees: Mapping[int, int] | None = None, absent: Sequence[int] = ()
    ) -> list[str]:
        """One step; a report says who sent it, and when. `trees` are roots by agent: all in that of 4, by default."""
        self.step += 1
        roots = dict.fromkeys(range(self.count), self.count - 1) if trees is None else trees
        sent = {sender: f"{sender}@{self.step}".ljust(LEAST_REPORT_BYTES).encode() for sender in senders}
        there = [agent not in absent for agent in range(self.count)]
        arrived = self.uplink.carry(self.step, self.step * self.step_s, self.places_m, there, roots, sent)
        return [data.decode().rstrip() for data in arrived]


uplinks: st.SearchStrategy[dict[str, Any]] = st.fixed_dictionaries(
    {"relay": st.booleans(), "base_m": st.just([0, 0]), "range_m": st.floats(1, 60)},
    optional={
        "loss": shares,
        "burst": st.fixed_dictionaries({"p_good_to_bad": shares, "p_bad_to_good": st.floats(0.01, 1)}),
        "latency_s": st.floats(0, 4),
        "jitter_s": st.floats(0, 4),
        "bandwidth": st.fixed_dictionaries(
            {"sender_bytes_per_s": rates, "receiver_bytes_per_s": rates, "queue_bytes": st.sampled_from([82, 90])}
        ),
        "outages": st.lists(times, max_size=1),
    },
)
agents = st.integers(0, 4)
step = st.tuples(st.sets(agents), st.dictionaries(agents, st.sampled_from([3, 4])), st.sets(agents, max_size=2))


@given(
    uplinks,
    st.lists(step, max_size=15),
    st.lists(st.tuples(st.floats(0, 30), st.floats(0, 30)), min_size=5, max_size=5),
)
def test_the_books_are_exact_in_every_step_and_the_same_again(
    uplink: dict[str, Any], steps: list[tuple[set[int], dict[int, int], set[int]]], places_m: list[Sequence[float]]
) -> None:
    """Under way before + sent = arrived + dropped + under way; no report comes twice; same seed, same outcome."""
    stages = [Stage(places_m, uplink) for _ in range(2)]
    before, came = 0, list[str]()
    for senders, trees, absent in steps:
        arrived, again = (stage.carry(sorted(senders), trees, sorted(absent)) for stage in stages)
        made = stages[0].uplink
        assert (arrived, made.dropped) == (again, stages[1].uplink.dropped)
        assert set(made.dropped) <= set(UPLINK_REASONS)
        assert Counter(reason for _, reason in made.losses) == made.dropped
        assert before + len(senders) == len(arrived) + sum(made.dropped.values()) + made.under_way
        before = made.under_way
        came += arrived
    assert len(came) == len(set(came))


@given(uplinks, st.lists(step, max_size=12))
def test_what_it_says_of_reports_is_what_happened(
    uplink: dict[str, Any], steps: list[tuple[set[int], dict[int, int], set[int]]]
) -> None:
    """Over all agents, as many outcomes as reports sent or under way, each what the counts have."""
    found, record = list[str](), (0, 0, {})
    for watched in range(5):
        stage = Stage(LINE_M, uplink)
        for senders, trees, absent in steps:
            record = (
                len(stage.carry(sorted(senders), trees, sorted(absent))),
                stage.uplink.under_way,
                stage.uplink.dropped,
            )
        found += stage.uplink.outcomes(watched)
    arrived, under_way, dropped = record
    assert found.count("arrived") == arrived
    assert sum(not outcome.startswith(("arrived", "dropped")) for outcome in found) == under_way
    for reason, count in dropped.items():
        assert sum(outcome.split(",")[0] == f"dropped: {reason}" for outcome in found) == count


def test_a_free_agent_beyond_the_range_is_lost() -> None:
    """With a relay or without: nobody carries for it; the range itself is within."""
    for relay in (False, True):
        stage = Stage([[5, 0], [5.01, 0]], {**BASE, "relay": relay})
        assert stage.carry([0, 1], trees={}) == ["0@0"]
        assert stage.uplink.dropped == {"range": 1}


def test_a_relay_takes_a_hop_a_step() -> None:
    """From the far end of a line, four hops; who is in range needs none."""
    stage = Stage(LINE_M, {**BASE, "relay": True})
    assert stage.carry([0, 4]) == ["0@0"]
    assert [stage.carry() for _ in range(4)] == [[], [], [], ["4@0"]]
    assert stage.uplink.under_way == 0


def explained(
    uplink: dict[str, Any], sender: int, trees: Mapping[int, int] | None = None
) -> tuple[bool, dict[str, Any]]:
    """Whether the range cuts an agent of the line off in a step in which it reports, and the numbers to it."""
    stage = Stage(LINE_M, uplink)
    stage.carry([sender], trees)
    (found,) = (one for one in stage.uplink.explain(sender) if one.reason == "range")
    return found.cuts, found.numbers


def test_the_way_through_a_tree_is_told() -> None:
    """The next hop and the number of hops to a member in range; without a relay or a tree there is none."""
    relayed = {**BASE, "relay": True}
    for sender in range(1, 5):
        cuts, numbers = explained(relayed, sender)
        assert (cuts, numbers["to"], numbers["hops"]) == (False, sender - 1, sender)
    for uplink, sender, trees in ((relayed, 0, None), (BASE, 2, None), (relayed, 2, {}), (relayed, 4, {3: 3, 4: 4})):
        cuts, numbers = explained(uplink, sender, trees)
        assert (cuts, "hops" in numbers) == (sender > 0, False)


def test_the_relay_remembers_only_reports_on_their_way() -> None:
    """Whatever became of the others: arrived, lost, outdated, or dropped with who carried them."""
    stage = Stage(LINE_M, {**BASE, "relay": True, "loss": 0.3})
    relay = stage.uplink._relay
    assert relay is not None
    for step in range(200):
        stage.carry([1, 3, 4], {0: 4, 1: 4, 2: 4, 3: 4, 4: 4} if step % 7 else {4: 4}, [2] if step % 11 == 0 else [])
        assert len(relay._relayed) == relay.under_way == stage.uplink.under_way


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_wall_and_another_tree_are_in_the_way(step_s: float) -> None:
    """Links are those of the air; a tree carries for its own members only. Who finds no way waits, but for 60 s."""
    walls = [{"a_m": [20, 0], "b_m": [20, 100], "until_s": 10}]
    wall = Stage(LINE_M, {**BASE, "relay": True}, step_s, walls=walls)
    wall.places_m[:, 1] = 1.0
    gone = round(10 / step_s)
    came = [wall.carry([4] if step == 0 else []) for step in range(gone + 6)]
    assert [step for step, arrived in enumerate(came) if arrived] == [gone + 4]  # four hops, once the wall is gone
    other = Stage(LINE_M, {**BASE, "relay": True}, step_s)
    trees = {0: 0, 1: 0, 2: 4, 3: 4, 4: 4}
    life = round(TIME_TO_LIVE_S / step_s)
    outcomes = [(other.carry([4] if step == 0 else [], trees), other.uplink.dropped) for step in range(life + 10)]
    assert [step for step, (_, dropped) in enumerate(outcomes) if dropped] == [life + 1]
    assert outcomes[life + 1][1] == {"expired": 1}
    assert not any(arrived for arrived, _ in outcomes)


@pytest.mark.parametrize(("trees", "absent", "reason"), [({4: 4, 3: 3}, [], "left"), (None, [3], "dead")])
def test_a_carrier_that_leaves_or_dies_drops_what_it_carries(
    trees: dict[int, int] | None, absent: list[int], reason: str
) -> None:
    stage = Stage(LINE_M, {**BASE, "relay": True})
    stage.carry([4])
    stage.carry([], trees, absent)
    assert (stage.uplink.dropped, stage.uplink.under_way) == ({reason: 1}, 0)


def test_each_hop_loses() -> None:
    """The share that comes over two hops and to the base is that of three tries."""
    stage = Stage(LINE_M, {**BASE, "relay": True, "loss": 0.2})
    came = [len(stage.carry([2] if step < 3000 else [])) for step in range(3010)]
    assert sum(came) / 3000 == pytest.approx(0.8**3, abs=0.04)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_delay_outage_and_a_narrow_operator(step_s: float) -> None:
    """In seconds and bytes per second; an outage takes what is sent in it; the operator's full queue drops the rest."""
    latency = round(2 / step_s)
    stage = Stage(LINE_M, {"latency_s": 2.0, "outages": [{"from_s": 1, "until_s": 2}]}, step_s)
    came = [stage.carry([0]) for _ in range(2 * latency + 1)]
    outage = {step for step in range(latency + 1) if 1 <= step * step_s < 2}
    assert came == [
        [f"0@{step - latency}"] if step >= latency and step - latency not in outage else []
        for step in range(2 * latency + 1)
    ]
    assert len(outage) == round(1 / step_s)
    narrow = Stage(LINE_M, {"bandwidth": {"receiver_bytes_per_s": 90 / step_s, "queue_bytes": 170}}, step_s)
    assert len(narrow.carry(range(5))) == 1
    assert (narrow.uplink.dropped, narrow.uplink.under_way) == ({"base_full": 2}, 2)


def test_bursts_on_the_uplink_keep_one_state_per_agent() -> None:
    """All links lead to the base: memory grows with the agents, not with their square."""
    count = 3000
    scenario = load(Scenario, {"agents": {"count": count}, "uplink": {"burst": {"p_good_to_bad": 0.1}}})
    tracemalloc.start()
    uplink = Uplink(scenario, lambda *_: [])
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 1000 * count
    assert len(uplink.carry(0, 0.0, np.zeros((count, 2)), [True] * count, {}, {count - 1: b"report"})) <= 1


def report(agent: int, sequence: int, step: int = 0) -> bytes:
    return encode_report(Report(agent, sequence, step, "root", 1.0, 2.0, 0, ()))


def test_the_world_checks_reports_as_the_operator_does() -> None:
    """Damaged, forged, early and second ones are rejected; a gap in a sequence is lost on the fabric, once."""
    core = WorldCore(load(Scenario, {"agents": {"count": 3}, "uplink": {"latency_s": 1}}))
    step_records = []
    for step in range(3):
        for agent, _ in core.begin(step, last=False):
            data = report(agent, step + (agent == 2), step)
            assert core.intake.hear_report(agent, data) is None
            for bad in (b"", data[:-1], report(agent + 1, 9), report(agent, 9, step + 1), data):
                assert core.intake.hear_report(agent, bad)
            core.intake.hear_act(agent, encode_act(Act(step, 0.0, 0.0, (), TreeStatus(), step + 1)))
        step_records.append(core.end())
    assert [record.rejected for record in step_records] == [15] * 3
    assert [record.transport_lost for record in step_records] == [1, 0, 0]
    assert [(record.reports_sent, record.reports_arrived) for record in step_records] == [(3, 0), (3, 3), (3, 3)]
    assert [(one.sequence, one.step) for one in core.forwarded] == [(3, 2), (4, 2), (5, 2)]
    assert core.forwarded[0].report == report(0, 1, 1)


def test_a_dead_radio_reports_to_nobody() -> None:
    fault = {"kind": "radio-dead", "at_s": 1.0, "agents": [0]}
    core = WorldCore(load(Scenario, {"agents": {"count": 2}, "uplink": {"loss": 1e-9}, "fault": [fault]}))
    step_records = []
    for step in range(2):
        core.inject(step)
        for agent, _ in core.begin(step, last=False):
            core.intake.hear_report(agent, report(agent, step, step))
            core.intake.hear_act(agent, encode_act(Act(step, 0.0, 0.0, (), TreeStatus(), step + 1)))
        step_records.append(core.end())
    assert [(record.reports_arrived, record.reports_dropped["dead"]) for record in step_records] == [(2, 0), (1, 1)]
