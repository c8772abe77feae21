"""The world's core: what it takes from agents, what it gives them, and that its counts add up."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.truth import DROP_REASONS, Truth, decode_truth, encode_truth
from deltaswarm_wire.codec import MAX_ID, MAX_SAMPLE_BYTES
from deltaswarm_wire.messages import MAX_SENSED, NOBODY, Act, Event, Frame, TreeStatus, encode_act, encode_frame
from tests.support.airs import EVERYTHING
from tests.support.cores import play, swarm
from tests.support.strategies import ACT, RADIO, complaint, strange
from tests.support.worlds import Stage, an_act, sample


@pytest.mark.parametrize(("distance_m", "works"), [(4.9, True), (5.1, False)])
def test_an_event_beyond_sensing_range_cannot_be_observed(distance_m: float, works: bool) -> None:
    """Whatever the agent claims: no work is done, and the claim is counted."""
    stage = Stage()
    event = stage.event(50 + distance_m, 50)
    stage.begin()
    stage.act(0, event)
    stage.end()
    assert stage.core.environment.states()[0].work_agent_s == works
    assert stage.core.refused_claims == (not works)


def test_observers_are_distinct_agents() -> None:
    """Two that observe do twice the work; one that claims thrice does its own; unknown events are refused."""
    stage = Stage()
    event = stage.event(50, 50)
    stage.begin()
    stage.act(0, event, event, event)
    stage.act(1, event, 77)
    stage.end()
    assert stage.core.environment.states()[0].work_agent_s == 2.0
    assert stage.core.refused_claims == 1


def test_work_completes_an_event_and_nobody_senses_it_again() -> None:
    """200 agent-seconds by three agents: 67 steps."""
    stage = Stage()
    event = stage.event(50, 50)
    for _ in range(67):
        assert all(frame.events == (Event(event, 50.0, 50.0),) for frame in stage.begin().values())
        for agent in range(3):
            stage.act(agent, event)
        stage.end()
    assert stage.core.environment.states()[0].completed_s == 66.0
    assert not any(frame.events for frame in stage.begin().values())


def test_changes_that_nobody_asks_for_are_not_kept() -> None:
    """Without a recorder they would pile up: at most one step's are held."""
    crew = swarm("smoke", "events.rate_hz=2")
    for record in play(crew, 30):
        now_s = record.time_s
        for event in crew.world.environment.changed:
            assert abs(now_s - event.arrived_s) < 1 or now_s in (event.sensed_s, event.worked_s, event.completed_s)
    assert len(crew.world.environment.states()) > 30


@pytest.mark.parametrize(
    "overrides",
    [
        ("events.rate_hz=1",),
        (*EVERYTHING, "events.rate_hz=1", "run.step_s=0.5", "uplink.loss=0.2", "uplink.latency_s=3"),
        ('fault=[{kind="kill",at_s=20,agents=[1]},{kind="radio-dead",at_s=10,agents=[2]}]', "run.accept_lost=1"),
    ],
    ids=["plain", "everything", "faults"],
)
def test_a_step_may_be_booked_after_the_next_one_has_begun(overrides: tuple[str, ...]) -> None:
    """Record, truth, samples and digest are those of the closed step."""
    at_once, late = swarm("smoke", *overrides), swarm("smoke", *overrides)
    begin, booked = late.world.begin, list[object]()

    def book() -> None:
        record = late.world.book()
        booked.append((record, late.world.truth(record), late.world.samples, late.world.closed.changed))

    def begin_then_book(step: int, last: bool) -> list[tuple[int, Frame]]:
        frames = list(begin(step, last))
        if step:
            book()
        return frames

    late.world.begin = begin_then_book  # type: ignore[assignment,method-assign]
    late.world.end = lambda: late.world.close(with_events=True)  # type: ignore[assignment,method-assign,return-value]
    expected = list[object]()
    for step in range(100):
        record = at_once.step(step, last=step == 99)
        world = at_once.world
        expected.append((record, world.truth(record), world.samples, world.closed.changed))
        late.step(step, last=step == 99)
    book()
    assert booked == expected
    assert late.world.digest.hex() == at_once.world.digest.hex()


@given(st.lists(st.tuples(st.integers(0, 5), strange(RADIO)), min_size=1, max_size=8))
def test_malformed_radio_frames_are_counted_never_raised(samples: list[tuple[int, bytes]]) -> None:
    """On any key, in any number; the step ends as if they had not been."""
    stage = Stage()
    stage.begin()
    taken: set[int] = set()
    refused = 0
    for agent, data in samples:
        valid = complaint(RADIO, data) is None
        reason = stage.core.intake.hear_radio(agent, data)
        assert (reason is None) == (valid and agent < 3 and agent not in taken)
        refused += reason is not None
        taken |= {agent} if reason is None else set()
    record = stage.end()
    assert (record.rejected, record.frames_sent) == (refused, len(taken))
    assert sum(stage.core.intake.rejected.values()) == refused
    assert stage.core.participants.is_closed


@given(st.lists(st.tuples(st.integers(0, 5), strange(ACT)), min_size=1, max_size=8))
def test_malformed_acts_are_counted_never_raised(samples: list[tuple[int, bytes]]) -> None:
    """They close nobody's step; only a valid act of this step does."""
    stage = Stage()
    stage.begin()
    refused = 0
    for agent, data in samples:
        is_due = agent in stage.core.participants.asked
        valid = is_due and complaint(ACT, data) is None and ACT.decode(data).step == stage.step
        assert (stage.core.intake.hear_act(agent, data) is None) == valid
        refused += not valid
    assert stage.end().rejected == refused


def test_one_frame_per_step_and_none_after_the_act() -> None:
    """A second one is refused, and one that follows the act; neither is heard."""
    stage = Stage()
    stage.begin()
    first = stage.say(0)
    assert stage.core.intake.hear_radio(0, sample(1)) is not None
    stage.act(1)
    assert stage.core.intake.hear_radio(1, sample(0)) is not None
    assert stage.end().rejected == 2
    assert {agent: frame.heard for agent, frame in stage.begin().items()} == {0: (), 1: ((0, first),), 2: ((0, first),)}


def test_whose_count_falls_back_is_named() -> None:
    stage = Stage()
    for counters in ((0, 30), (1, 31), (2, 32)):
        stage.begin()
        for counter in counters:
            stage.core.intake.hear_radio(1, sample(counter))
        stage.core.intake.accept_any_next(2)
        stage.core.intake.hear_radio(2, sample(0))
        stage.end()
    totals = stage.core.totals(True)
    assert (totals["fell_back"], totals["transport_lost"]) == ({"1": 2}, {"1": 29 * 3})


def test_counts_that_overflow_do_not_harm_the_recorder() -> None:
    """A forged count of frames, twice: what is lost by it fits into the truth."""
    stage = Stage()
    stage.begin()
    for counter in (MAX_ID, 0, MAX_ID):
        stage.core.intake.hear_radio(0, sample(counter))
    truth = stage.core.truth(stage.end())
    assert decode_truth(encode_truth(truth)).step_record == truth.step_record


def test_an_act_of_a_step_to_come_is_refused() -> None:
    """It would close a step that has not begun; one of a step gone by, which was closed then, is one too many."""
    stage = Stage()
    stage.begin()
    reason = stage.act(0, step=1)
    assert reason is not None
    assert "1 has not begun" in reason
    stage.end()
    stage.begin()
    assert stage.act(1, step=0) is not None
    assert stage.core.participants.asked == {0, 1, 2}
    assert stage.end().rejected == 1
    assert stage.core.intake.excess == {1: 1}


def test_a_second_act_changes_nothing() -> None:
    stage = Stage()
    event = stage.event(50, 50)
    stage.begin()
    stage.act(0, vx_mps=1.0)
    stage.act(0, event, vx_mps=-1.0)
    stage.end()
    assert stage.core.environment.states()[0].work_agent_s == 0
    assert stage.begin()[0].x_m == 51.0


def test_a_gap_in_counters_is_a_loss_on_the_fabric() -> None:
    """Counted per missing frame, apart from the loss on the air; a counter that goes back is a restart."""
    stage = Stage()
    lost = []
    for counter in (0, 1, 4, 5, 0, 1):
        stage.begin()
        stage.core.intake.hear_radio(0, sample(counter))
        lost.append(stage.end().transport_lost)
    assert lost == [0, 0, 2, 0, 0, 0]


def test_the_heard_bytes_are_the_very_bytes_sent() -> None:
    stage = Stage(2)
    stage.begin()
    odd = b"\x93\x03\xcd\x00\x00\xc5\x00\x02hi"
    assert stage.core.intake.hear_radio(0, odd) is None
    stage.end()
    assert stage.begin()[1].heard == ((0, odd),)


def test_an_agent_senses_what_is_in_its_own_range() -> None:
    stage = Stage()
    stage.core.environment.positions_m[1] = (80.0, 20.0)
    near, far = stage.event(51, 50), stage.event(79, 20)
    frames = stage.begin()
    assert [frames[agent].events for agent in (0, 1)] == [(Event(near, 51, 50),), (Event(far, 79, 20),)]
    assert (frames[1].x_m, frames[1].y_m, frames[1].step, frames[1].time_s) == (80.0, 20.0, 0, 0.0)


def test_a_crowded_frame_drops_what_does_not_fit_and_says_so() -> None:
    """However many and large the frames in range, what the agent gets is within the limit of a sample."""
    stage = Stage(9, events={"rate_hz": 0})
    for number in range(300):
        stage.event(50, 50 + number / 100)
    stage.begin()
    said = [stage.say(agent, bytes(7000)) for agent in range(9)]
    assert max(map(len, said)) > 7000
    stage.end()
    frames = stage.begin()
    record = stage.end()
    assert all(len(encode_frame(frame)) <= MAX_SAMPLE_BYTES for frame in frames.values())
    heard = [len(frame.heard) for frame in frames.values()]
    assert set(heard) == {3}
    assert (record.frames_received, record.frames_dropped["frame_full"]) == (27, 9 * 8 - 27)


def test_more_events_than_a_frame_may_hold_are_left_out_and_counted() -> None:
    """For each agent that senses them. The frame stays within its limits; all have been sensed all the same."""
    stage = Stage(2)
    for _ in range(MAX_SENSED + 3):
        stage.event(50, 50)
    for frame in stage.begin().values():
        assert len(frame.events) == MAX_SENSED == 1000
        assert len(encode_frame(frame)) <= MAX_SAMPLE_BYTES
    stage.end()
    assert stage.core.totals(True)["events_cut"] == 2 * 3
    assert all(event.sensed_s == 0.0 for event in stage.core.environment.states())


def test_a_late_agent_keeps_its_velocity_and_gets_no_frame() -> None:
    """Until an act of its arrives; it is counted late once per step that it misses."""
    stage = Stage(2)
    stage.begin()
    stage.act(0, vx_mps=1.0)
    assert stage.end().agents_late == 0
    stage.begin()
    assert stage.end(0).agents_late == 1
    assert list(stage.begin()) == [1]
    assert stage.core.environment.positions_m[0].tolist() == [52.0, 50.0]
    assert stage.end().agents_late == 0
    stage.begin()
    assert stage.act(0, step=1) is None
    stage.end()
    assert list(stage.begin()) == [0, 1]


def test_a_dead_agent_stops_and_hears_nothing() -> None:
    """It neither moves nor senses any more; frames to it are dropped for that reason, and it is shown as dead."""
    stage = Stage(2)
    stage.begin()
    stage.act(0, vx_mps=1.0)
    stage.say(1)
    stage.end()
    stage.core.participants.token_gone(0)
    stage.event(50, 50)
    assert list(stage.begin()) == [1]
    record = stage.end()
    assert (record.agents_alive, record.frames_dropped["dead"], record.frames_received) == (1, 1, 0)
    assert stage.core.truth(record).bodies[0][1:4] == (50.0, 50.0, "dead")
    assert stage.core.totals(complete=True)["agents_lost"] == [0]


@pytest.mark.parametrize("radio", [[], ["radio.loss=0.4"], list(EVERYTHING)], ids=["disc", "loss", "everything"])
def test_every_frame_sent_is_heard_dropped_or_in_flight(radio: list[str]) -> None:
    """In every step: sent times all others = heard, dropped by reason, in flight; also with deaths, returns, hangs."""
    crew = swarm("smoke", "agents.count=10", "events.rate_hz=0.3", "control.delta=2", *radio)
    world = crew.world
    changes = {
        60: world.participants.token_gone,
        90: world.participants.token_gone,
        120: world.participants.token_back,
        150: world.participants.token_gone,
    }
    in_flight = heard = 0
    dropped = Counter[str]()
    for step in range(250):
        changes.get(step, lambda agent: None)(step // 30)
        record = crew.step(step, last=False)
        drops = record.frames_dropped
        came = record.frames_sent * 9 + record.frames_duplicated
        assert in_flight + came == record.frames_received + sum(drops.values()) + record.frames_in_flight
        assert record.bytes_sent >= 6 * record.frames_sent
        in_flight, heard = record.frames_in_flight, heard + record.frames_received
        dropped.update(drops)
    assert heard > 500
    if radio == list(EVERYTHING):
        assert {reason for reason in DROP_REASONS if not dropped[reason]} == {"frame_full"}


def digest_of(heard: bytes, act: Act, agent: int = 0) -> str:
    stage = Stage()
    stage.begin()
    stage.core.intake.hear_radio(agent, heard)
    stage.core.intake.hear_act(agent, encode_act(act))
    stage.end()
    return stage.core.digest.hex()


def test_the_digest_shows_one_changed_byte() -> None:
    """Of a radio frame or an act; the same bytes give the same digest."""
    frame, act = sample(0), an_act(0, vx_mps=0.5)
    assert digest_of(frame, act) == digest_of(frame, act)
    others = [
        (sample(0, b"there"), act),
        (sample(1), act),
        (frame, act._replace(vx_mps=0.25)),
        (frame, act._replace(observed=(1,))),
        (frame, act._replace(until=2)),
        (frame, act._replace(tree_status=TreeStatus("root", root=0))),
    ]
    assert len({digest_of(*other) for other in [*others, (frame, act)]}) == 7


def test_the_order_of_arrival_does_not_change_the_world() -> None:
    """Inputs are processed in agent order: same digest, same places, same frames heard."""
    ends = []
    for order in ((0, 1, 2), (2, 0, 1)):
        stage = Stage()
        for _ in range(3):
            stage.begin()
            for agent in order:
                stage.say(agent)
            for agent in reversed(order):
                stage.act(agent, vx_mps=agent / 4)
            stage.end()
        ends.append((stage.core.digest.hex(), stage.core.environment.positions_m.tolist(), stage.begin()))
    assert ends[0] == ends[1]


def test_the_truth_is_what_happened_and_goes_over_the_wire() -> None:
    """Roles as the acts say, links as they were heard, each change of an event once."""
    crew = swarm("smoke", "agents.count=8", "events.rate_hz=0.2", "control.delta=2")
    completed: list[int] = []
    for step in range(300):
        record = crew.step(step, last=False)
        truth = crew.world.truth(record)
        assert decode_truth(encode_truth(truth)) == truth
        assert isinstance(truth, Truth)
        assert sum(body.role == "root" for body in truth.bodies) == record.trees
        assert len(truth.links) == record.frames_received
        completed += [event.event for event in truth.events if event.completed_s is not None]
        for body in truth.bodies:
            assert (body.root == NOBODY) == (body.role in ("free", "attending", "leaving"))
            assert (body.level == 0) == (body.parent == NOBODY)
    assert len(completed) == len(set(completed))
    assert set(completed) == {event.event for event in crew.world.environment.states() if event.completed_s is not None}
