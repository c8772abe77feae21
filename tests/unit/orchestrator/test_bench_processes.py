"""How runs with real processes grow: one row per size, and room for all agents at the router."""

import pytest

from benchmarks import processes
from benchmarks.__main__ import parser
from deltaswarm_orchestrator.processes.starter import LEASE, OTHER_SESSIONS, STARTED, room_for


def test_a_thousand_agents_and_more_may_join_at_once() -> None:
    """Beyond Zenoh's own limits on sessions and handshakes."""
    settings = dict(room_for(1500))
    for name in ("max_sessions", "accept_pending"):
        assert settings[f"transport/unicast/{name}"] == str(1500 + OTHER_SESSIONS)
    assert int(settings[LEASE]) == 90_000  # a link may be silent while the others start
    assert LEASE not in dict(room_for(100))


def test_defaults_are_the_measurements_own() -> None:
    """Other measurements keep theirs."""
    many = parser().parse_args(["processes"])
    assert (many.sizes, many.steps) == ([25, 100, 400, 1000], 100)
    in_one = parser().parse_args(["scale"])
    assert (in_one.sizes[-1], in_one.steps) == (1000, 1000)


@pytest.mark.processes
def test_each_size_has_a_row() -> None:
    """Smallest first, whatever the order; no process is left on Python's list."""
    rows = processes.measure((6, 3), 20)["sizes"]
    assert [row["agents"] for row in rows] == [3, 6]
    for row in rows:
        assert row["agent_steps_per_s"] == pytest.approx(row["agents"] * row["steps_per_s"])
        assert 1 < row["median_agent_pss_mb"] <= row["largest_agent_pss_mb"] < 50
        assert row["open_files"] > 3 * row["agents"]
        assert 0 <= row["stolen_share"] <= 1
    assert not STARTED
