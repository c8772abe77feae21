"""Controllers at fault, by real processes: what happens is what docs/CONTROLLERS.md says, in time and in one line."""

import json
import re
import signal
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_cli.main import main
from tests.support.swarms import is_running, running, sets, wait_until

pytestmark = pytest.mark.processes

MODULE = '''
import os
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from deltaswarm_agent.controller import Decision
from deltaswarm_wire.checked import key


@dataclass(frozen=True)
class Options:
    victim: int = key(3, "who is at fault", low=0)
    at_step: int = key(100, "when", low=0)


class Well:
    """Broadcasts two kilobytes in each step."""

    Settings = Options

    def __init__(self, context):
        self.context, self.options = context, context.settings

    def step(self, percept):
        if self.context.agent == self.options.victim and percept.step == self.options.at_step:
            return self.fail()
        return Decision(payload=bytes(2000))

    def fail(self):
        return Decision()


class Raises(Well):
    def fail(self):
        raise RuntimeError("no such thing\\nat all")


class NotANumber(Well):
    def fail(self):
        return Decision((float("nan"), 0.0))


class TooLong(Well):
    def fail(self):
        return Decision(payload=bytes(9000))


class Sleeps(Well):
    def fail(self):
        while not Path(__file__).with_name("wake").exists():
            time.sleep(0.05)
        return Decision()


class Quits(Well):
    def fail(self):
        raise SystemExit(0)


class LeavesThreads(Well):
    def fail(self):
        threading.Thread(target=time.sleep, args=(600,)).start()
        return Decision()


class Vanishes(Well):
    def fail(self):
        os._exit(0)


class Forks(Well):
    def fail(self):
        child = os.fork()
        if child == 0:
            os.fork()
            Path(__file__).with_name(f"pid-{os.getpid()}").touch()
            time.sleep(3600)
        return Decision()


class SleepsAmongSleepers(Well):
    def step(self, percept):
        if self.context.agent == self.options.victim and percept.step >= self.options.at_step:
            time.sleep(600)
        return Decision((0.1, 0.0), until=percept.step + 50)


class Nosy(Well):
    def __init__(self, context):
        super().__init__(context)
        print(sys.argv, file=sys.stderr)


class NeverThere(Well):
    def __init__(self, context):
        raise OSError("no body today")
'''


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The module, where agents' processes and this one find it."""
    (tmp_path / "at_fault.py").write_text(MODULE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def at_fault(name: str, *more: str) -> list[str]:
    return sets(f"control.mode=at_fault:{name}", *more)


def finished(folder: Path, name: str, *arguments: str) -> tuple[int, dict[str, Any], str]:
    with running(folder / name, *at_fault(name), *arguments) as swarm:
        code, _, errors = swarm.finish()
        return code, swarm.summary(), errors


def test_two_kilobytes_in_each_step_are_carried(module: Path) -> None:
    """By six agents: nothing is lost on the fabric, all bytes are counted, the same in one process."""
    code, found, _ = finished(module, "Well")
    assert (code, found["valid"], found["agents_lost"], found["transport_lost"]) == (0, True, [], 0)
    assert found["bytes_sent_per_s"]["mean"] == pytest.approx(6 * 2007, rel=0.01)
    assert found["frames_dropped"]["frame_full"] == 0
    assert main(["run", "smoke", *at_fault("Well"), "--in-process", "--out", str(module / "one")]) == 0
    assert json.loads((module / "one" / "summary.json").read_text())["digest"] == found["digest"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Raises", "RuntimeError: no such thing at all"),
        pytest.param("NotANumber", "velocity must", marks=pytest.mark.slow),
        pytest.param("TooLong", "at most 8192", marks=pytest.mark.slow),
        ("Quits", "SystemExit: 0"),
    ],
)
def test_an_agent_whose_controller_fails_is_counted_as_lost(module: Path, name: str, said: str) -> None:
    """The run goes on to its end without it; one line says whose controller failed, when and why.

    What it raised is shown once, from its own frame on.
    """
    code, found, errors = finished(module, name)
    assert (code, found["complete"], found["agents_lost"]) == (1, True, [3])
    line = next(line for line in errors.splitlines() if said in line and line.startswith("deltaswarm: "))
    assert f"at_fault:{name} " in line
    assert "step 100" in line
    assert "at_fault.py:" in line
    raises = name in ("Raises", "Quits")
    assert (errors.count("Traceback"), errors.count(", in fail")) == (raises, raises)
    assert "deltaswarm_agent" not in errors
    assert main(["run", "smoke", *at_fault(name), "--in-process", "--out", str(module / "one")]) == 1
    alone = json.loads((module / "one" / "summary.json").read_text())
    assert (alone["agents_lost"], alone["digest"]) == ([3], found["digest"])
    for summary in (found, alone):
        due, answered = summary["agent_steps"]["due"], summary["agent_steps"]["answered"]
        [failed] = summary["agents_failed"]
        assert (failed["step"], due, answered) == (100, 6 * summary["steps"], due - (summary["steps"] - 100))
        assert said in failed["cause"]
        assert summary["invalid_because"][0].startswith("agent 3 failed in step 100 ")


def test_an_agent_that_ends_early_is_named_though_its_exit_code_is_0(module: Path) -> None:
    """With the step, which the world knows; the run goes on without it."""
    code, found, _ = finished(module, "Vanishes")
    assert (code, found["complete"], found["agents_lost"]) == (1, True, [3])
    assert [row["cause"] for row in found["agents_failed"]] == ["ended with exit code 0"]
    assert found["why"] == ["agent 3 ended with exit code 0 in step 100"]


def test_a_thread_of_a_controller_keeps_no_process_alive(module: Path) -> None:
    """It is no daemon, and would run for ten minutes; its agent ends as all do."""
    code, found, _ = finished(module, "LeavesThreads")
    assert (code, found["valid"], found["why"]) == (0, True, [])


def test_processes_of_a_controller_end_with_the_run(module: Path) -> None:
    """Those that these have started, too."""
    code, found, _ = finished(module, "Forks")
    assert (code, found["valid"], found["why"]) == (0, True, [])
    started = [int(file.name.removeprefix("pid-")) for file in module.glob("pid-*")]
    assert len(started) == 2
    assert not any(map(is_running, started))


def test_a_controller_that_takes_too_long_stalls_nobody(module: Path) -> None:
    """The world goes on without its agent, which takes part again once it has answered."""
    arguments = at_fault("Sleeps", "run.step_timeout_s=0.5", "run.duration_s=100000", "control.at_step=20")
    with running(module / "run", *arguments, "--record", "off") as swarm:
        swarm.wait_for_steps(1)
        wait_until(lambda: "continues without agent 3" in swarm.log("world"), "a step without agent 3")
        swarm.wait_for_steps(20)
        (module / "wake").touch()
        wait_until(lambda: "agent 3, which hung, answers again" in swarm.log("world"), "its answer")
        swarm.process.send_signal(signal.SIGINT)
        swarm.finish()
        assert swarm.summary()["agents_lost"] == []


def test_a_hanging_agent_among_sleeping_ones_stalls_nobody(module: Path) -> None:
    """A step in which nobody is asked is over at once, although an agent hangs."""
    arguments = at_fault("SleepsAmongSleepers", "run.step_timeout_s=2", "run.duration_s=300", "events.rate_hz=0")
    code, found, _ = finished(module, "SleepsAmongSleepers", *arguments)
    assert (code, found["complete"], [row["agent"] for row in found["agents_hung"]]) == (1, True, [3])
    assert found["wall_s"] < 60  # not 2 s for each of 200 steps


def test_a_run_whose_agents_all_hang_for_long_ends(module: Path) -> None:
    """After the time in which all must be up, which is shorter than the time-outs of all steps."""
    keys = ["agents.count=1", "control.victim=0", "control.at_step=5", "run.step_timeout_s=1", "run.start_timeout_s=10"]
    code, found, errors = finished(module, "Sleeps", *sets(*keys))
    assert (code, found["complete"]) == (1, False)
    assert "all agents hang: none has answered for 10 s" in errors


def test_no_agent_is_told_the_command_line(module: Path) -> None:
    """It holds the run's seed and its scenario."""
    with running(module / "run", *at_fault("Nosy", "run.duration_s=5"), "--seed", "4711") as swarm:
        swarm.finish()
    log = (module / "run" / "logs" / "agent-3.log").read_text()
    assert "deltaswarm" in log
    assert "4711" not in log
    assert "--set" not in log


def test_agents_that_cannot_be_made_end_the_run(module: Path) -> None:
    """Before its first step, with the reason; the same in one process."""
    with running(module / "run", *at_fault("NeverThere", "run.start_timeout_s=30")) as swarm:
        code, _, errors = swarm.finish()
    assert code == 1
    assert re.search("at_fault:NeverThere .*OSError: no body", errors)
    assert errors.count("Traceback") == 1
    assert main(["run", "smoke", *at_fault("NeverThere"), "--in-process", "--out", str(module / "one")]) == 1
