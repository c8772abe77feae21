"""A flood costs the flooder alone: the others do byte for byte what they do beside an agent that fell silent."""

from pathlib import Path

import pytest

from tests.hostile.attacker import FLOODS, LATENESS, REFUSED, SILENCE, WHO
from tests.hostile.stage import MOST_MB, Ended, harm, play
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

STEPS = 120
REST = ("control.rest_s=0.02",)
"""With it a session sends up to five thousand samples per second. `python -m tests.hostile` does without it."""

MALFORMED = ("malformed reports", "malformed frames", "malformed acts")


@pytest.fixture(scope="module")
def silence(tmp_path_factory: pytest.TempPathFactory) -> Ended:
    return play(tmp_path_factory.mktemp("silence") / "run", "smoke", STEPS, SILENCE)


@pytest.mark.parametrize("flood", first_of([name for name in FLOODS if name not in MALFORMED]))
def test_a_flood_costs_the_flooder_alone(flood: str, silence: Ended, tmp_path: Path) -> None:
    """No other agent loses a step, no process grows, and the agent is named.

    Reports come from four sessions, and as fast as they can.
    """
    sessions, rest = (4, ()) if flood == "reports" else (1, REST)
    flooded = play(tmp_path / "run", "smoke", STEPS, flood, sessions, rest)
    assert harm(flooded, silence) == []
    assert flooded.world["excess"].keys() == {str(WHO)}
    assert (flooded.summary["steps"], flooded.summary["agents_late"]) == (STEPS, 1)
    assert not flooded.summary["valid"]
    assert any(f"agent {WHO} sent" in reason for reason in flooded.summary["invalid_because"])


def test_malformed_samples_are_counted_for_their_agent(silence: Ended, tmp_path: Path) -> None:
    """They harm nobody else, and the world's log says so once."""
    flooded = play(tmp_path / "run", "smoke", STEPS, "malformed reports", others=REST)
    assert harm(flooded, silence) == []
    assert flooded.refused.keys() == {str(WHO)}
    assert flooded.summary["samples_rejected"] == flooded.refused[str(WHO)]
    log = (tmp_path / "run" / "logs" / "world-0.log").read_text()
    assert log.count(f"dropped a sample on a key of agent {WHO}") == 1


@pytest.mark.parametrize("request_", first_of([*REFUSED]))
def test_what_the_router_refuses_harms_nobody(request_: str, silence: Ended, tmp_path: Path) -> None:
    """Nor does it fill the disk, although Zenoh has an error for each request, thousands per second."""
    assert harm(play(tmp_path / "run", "smoke", STEPS, request_, others=REST), silence) == []


@pytest.mark.slow
def test_a_flood_of_reports_takes_no_room_on_the_uplink(tmp_path: Path) -> None:
    """A narrow one, with loss and delay: what the others do, hear and sense is as beside an agent that fell silent."""
    uplink = ["uplink.loss=0.2", "uplink.latency_s=2", "uplink.bandwidth.receiver_bytes_per_s=400"]
    silence = play(tmp_path / "silence", "smoke", STEPS, SILENCE, others=uplink)
    flooded = play(tmp_path / "run", "smoke", STEPS, "reports", others=[*REST, *uplink])
    assert flooded.outcome.events == silence.outcome.events
    columns = ("agents_in_trees", "trees", "frames_sent", "bytes_sent", "frames_received", "events_open")
    for one, other in zip(flooded.outcome.step_records, silence.outcome.step_records, strict=True):
        assert [getattr(one, name) for name in columns] == [getattr(other, name) for name in columns]
    assert flooded.world["excess"].keys() == {str(WHO)}
    assert max(flooded.peak_mb.values()) < MOST_MB
    sent = [record.reports_sent for record in flooded.outcome.step_records]
    assert max(sent) <= flooded.outcome.step_records[0].agents_alive, "at most one of each agent in a step"


def test_who_is_late_again_and_again_is_waited_for_ever_less(tmp_path: Path) -> None:
    """Each answer comes long after the step: the run goes on, at the cost of one patience or two, and counts them."""
    ended = play(tmp_path / "run", "smoke", STEPS, LATENESS, others=["run.step_timeout_s=0.5", "control.late_by_s=1"])
    summary = ended.summary
    assert (summary["steps"], summary["agents_lost"], ended.world["excess"]) == (STEPS, [], {})
    log = (tmp_path / "run" / "logs" / "world-0.log").read_text()
    assert 1 <= log.count(f"without agent {WHO}") <= summary["agents_late"]  # on a busy machine others are late, too
