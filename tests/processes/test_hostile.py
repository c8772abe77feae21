"""A hostile client on the router's port: what it may not do, and what it can break (nothing)."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.processes.process import wait_for
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.keys import ACT, FRAME, RADIO, REPORT, Keys
from deltaswarm_wire.session import RouterLink, client_pairs, configured
from tests.support.stranger import RUBBISH
from tests.support.swarms import PATIENCE_S, started, wait_for_end, wait_until

pytestmark = pytest.mark.processes

RUN = "hostile"
STEPS = 500


class Stage:
    def __init__(self, swarm: Swarm, observer: Observer, folder: Path) -> None:
        self.swarm = swarm
        self.observer = observer
        self.folder = folder
        self.keys = Keys(RUN)

    def client(self, user: str, password: str) -> zenoh.Session:
        """A stranger's session, over the ordinary transport."""
        link = RouterLink(self.swarm.endpoint, user, password)
        return zenoh.open(configured(zenoh.Config, client_pairs(link), link))

    def is_running(self) -> bool:
        self.observer.work(0.01)
        return self.observer.status is not None and self.observer.status.phase == "running"

    def finish(self) -> dict[str, Any]:
        wait_for_end(self.swarm, self.observer)
        assert not wait_for(self.swarm.parts, PATIENCE_S)
        outcome = run_tables.read_outcome(self.folder)
        summary = summarise(outcome, load_scenario("smoke", SETTINGS))
        return summary | {"world": outcome.world, "operator": outcome.operator}


SETTINGS = (f"run.duration_s={STEPS}", "run.clock=realtime", "run.real_time_factor=50", "record=off")


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    with started(load_scenario("smoke", SETTINGS), RUN, tmp_path) as (swarm, observer):
        made = Stage(swarm, observer, tmp_path)
        wait_until(made.is_running, "the first steps")
        yield made


@pytest.mark.parametrize("credentials", [("", ""), ("agent-3", "guess"), ("nobody", "x"), ("world", "")])
def test_without_credentials_nobody_comes_in(stage: Stage, credentials: tuple[str, str]) -> None:
    """The router refuses a session without a name, with a wrong password, and with a name it does not know."""
    with pytest.raises(zenoh.ZError):
        stage.client(*credentials)


def test_an_agent_hears_nothing_but_its_own_frame(stage: Stage) -> None:
    """With agent 3's credentials: no other's frame or radio, no report, no clock, not the truth."""
    with stage.client("agent-3", stage.swarm.password("agent-3")) as session:
        heard: list[str] = []
        keys = stage.keys
        wanted = [f"{keys.root}/**", keys.agent("*", FRAME), keys.agent(4, FRAME), keys.all_radio, keys.all_reports]
        wanted += [keys.all_acts, keys.clock, keys.truth, keys.status, keys.agent(3, FRAME)]
        subscribers = [
            session.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr))) for key in wanted
        ]
        wait_until(lambda: len(heard) >= 100, "its own frames")
        assert set(heard) == {keys.agent(3, FRAME)}
        assert len(subscribers) == len(wanted)
    assert stage.finish()["complete"]


def test_an_agent_cannot_speak_as_another_nor_as_the_world(stage: Stage) -> None:
    """What agent 3 sends on agent 4's keys, as clock or as frame reaches nobody."""
    keys = stage.keys
    with stage.client("agent-3", stage.swarm.password("agent-3")) as session:
        for key in (keys.agent(4, ACT), keys.agent(4, RADIO), keys.agent(4, REPORT), keys.clock, keys.agent(4, FRAME)):
            for _ in range(20):
                session.put(key, b"forged", congestion_control=zenoh.CongestionControl.BLOCK)
        mark = session.declare_publisher(keys.agent(3, ACT), congestion_control=zenoh.CongestionControl.BLOCK)
        wait_until(lambda: mark.matching_status.matching, "a way to the world")  # behind all that was sent before
        mark.put(b"mark")
        summary = stage.finish()
    assert summary["valid"], summary["invalid_because"]
    assert summary["world"]["rejected"] == {"3": 1}
    assert summary["samples_rejected"] == 1
    assert summary["agents_lost"] == []


def test_rubbish_on_its_own_keys_is_counted_and_harms_nobody(stage: Stage) -> None:
    """Garbage, 10 MB, an unknown version, a NaN velocity, acts of the future: dropped, counted, survived."""
    stranger = [sys.executable, "-m", "tests.support.stranger", RUN]
    stranger += [stage.swarm.endpoint, stage.swarm.password("agent-3")]
    with subprocess.Popen(stranger, stdin=subprocess.PIPE, cwd=Path(__file__).parents[2]) as process:
        summary = stage.finish()
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0
    assert summary["valid"], summary["invalid_because"]
    assert summary["world"]["rejected"] == {"3": sum(map(len, RUBBISH.values()))}
    assert summary["operator"]["rejected"] == 0
    assert summary["steps"] == STEPS
    assert summary["agents_lost"] == []
    log = (stage.folder / "logs" / "world-0.log").read_text()
    assert log.count("dropped a sample") == 1
