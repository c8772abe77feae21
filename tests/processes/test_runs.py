"""Whole runs with real processes: the same digest as in one process, true figures, nothing left behind."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.swarms import COMMAND, PATIENCE_S, UNHURRIED, is_running, run, running, sets, wait_until
from tests.support.tiers import first_of, nightly

pytestmark = pytest.mark.processes

BUSY = "while True: pass"


def test_runs_with_processes_and_one_without_have_one_digest(tmp_path: Path) -> None:
    """Scheduling does not matter: not under load, and not at all in one process."""
    short = ("--set", "run.duration_s=150")
    quiet = run(tmp_path / "quiet", *short, "--record", "off")
    burners = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(3)]
    try:
        loaded = run(tmp_path / "loaded", *short)
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
    inside = run(tmp_path / "inside", *short, "--in-process")
    assert len({summary["digest"] for summary in (quiet, loaded, inside)}) == 1
    assert {summary["waiting_time_s"]["mean"] for summary in (quiet, inside)} == {quiet["waiting_time_s"]["mean"]}


EVENTFUL = ("events.rate_hz=0.3", "run.duration_s=300")
"""Trees form, and agents are sent about."""
POLICY = [(-1) ** k * (k % 7) / 4 for k in range(24)]
SAME = {
    "hierarchical": ("control.mode=hierarchical", "radio.loss=0.2", "run.duration_s=200"),
    "central": ("control.mode=central", "radio.range_m=150", *EVENTFUL),
    "collisions": ("world.dynamics=physics", "world.radius_m=0.5", "world.avoidance=none", "run.duration_s=60"),
    "quadcopters": (
        "world.dynamics=jsbsim",
        "world.gust_mps=2",
        "world.heights_m=[5,9]",
        'fault=[{kind="rotor-lost",at_s=5,agents=[1]}]',
        "run.accept_lost=1",
        "run.duration_s=20",
    ),
    "decentralised": ("control.mode=decentralised", "radio.loss=0.2", "run.duration_s=200"),
    "learned": ("control.mode=hybrid", "control.delta_rule=learned", f"control.policy={POLICY}", *EVENTFUL),
    "bandit": ("control.mode=hybrid", "control.delta_rule=bandit", *EVENTFUL),
    "adaptive": ("control.mode=adaptive", *EVENTFUL),
}


@pytest.mark.parametrize("name", [*SAME][:3] + nightly(*[*SAME][3:]))
def test_settings_have_the_same_digest_with_and_without_processes(tmp_path: Path, name: str) -> None:
    """Each mode, also with loss on the air, and robots that feel what they bump into."""
    options = ["--record", "off", *sets(*SAME[name])]
    outside, inside = run(tmp_path / "outside", *options), run(tmp_path / "inside", "--in-process", *options)
    assert outside["valid"]
    assert outside["digest"] == inside["digest"]
    assert outside.get("bodies") == inside.get("bodies")
    assert outside["frames_dropped"]["loss"] > 0 or "radio.loss=0.2" not in SAME[name]
    assert name != "collisions" or outside["bodies"]["bumped_share"] > 0.0


def test_a_run_is_valid_and_leaves_no_process(tmp_path: Path) -> None:
    """All parts have ended when the command returns, and no message was lost on the way."""
    with running(tmp_path / "run", *UNHURRIED) as swarm:
        pids = wait_until(lambda: swarm.pids, "process ids")
        code, printed, _ = swarm.finish()
        assert code == 0
        assert "digest" in printed
        assert not [name for name, pid in pids.items() if is_running(pid)]
        summary = swarm.summary()
        assert summary["valid"]
        assert summary["transport_lost"] == 0
        assert summary["steps"] == 300
        assert len(pids) == 6 + 2
        assert len(set(pids.values())) == len(pids)


def test_the_run_folder_is_whole(tmp_path: Path) -> None:
    """The files that the design names are there, and nothing half-written."""
    run(tmp_path / "run", "--record", "wire")
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names >= {
        "manifest.json",
        "scenario.toml",
        "summary.json",
        "events.csv",
        "series.csv",
        "recording.mcap",
        "wire.mcap",
        "layout.json",
        "logs",
    }
    assert not [name for name in names if name.endswith(".part")]
    assert not (tmp_path / "run.part").exists()
    assert {path.name for path in (tmp_path / "run" / "logs").glob("*.log")} == {
        "world-0.log",
        "operator-0.log",
        *(f"agent-{agent}.log" for agent in range(6)),
    }


def test_nothing_is_overwritten_without_force(tmp_path: Path) -> None:
    """A folder that is there stays as it is, and the command says how to replace it."""
    run(tmp_path / "run", "--in-process", "--record", "off")
    before = (tmp_path / "run" / "summary.json").read_text()
    refused = [*COMMAND, "run", "smoke", "--in-process", "--out", str(tmp_path / "run"), "--seed", "2"]
    done = subprocess.run(refused, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--force" in done.stderr
    assert (tmp_path / "run" / "summary.json").read_text() == before
    done = subprocess.run([*refused, "--force", "--json"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["seed"] == 2


@pytest.mark.parametrize(("factor", "can_be_held"), [(50, True), (10_000, False)])
def test_real_time_is_never_faster_than_its_factor(tmp_path: Path, factor: int, can_be_held: bool) -> None:
    """100 simulated seconds take 100 s over the factor at least; where the machine is slower, the run says so."""
    options = ["--set", "run.clock=realtime", "--set", f"run.real_time_factor={factor}", "--set", "run.duration_s=100"]
    with running(tmp_path / "run", "--record", "off", *options) as swarm:
        code, _, errors = swarm.finish()
        summary = swarm.summary()
    assert code == (0 if summary["valid"] else 1)  # agents that cannot follow at all may count as hung
    assert summary["valid"] or not can_be_held
    assert (summary["complete"], summary["steps"]) == (True, 100)
    assert summary["wall_s"] >= 100 / factor
    overruns = summary["realtime_overruns"]
    assert overruns > 0 or can_be_held, "a step in 0.1 ms"
    assert (f"{overruns} steps" in errors) == (overruns > 0)


ENVIRONMENTS = [{"RUST_LOG": "trace"}, {"PYTHONIOENCODING": "ascii"}, {"PYTHONUTF8": "0", "LC_ALL": "C"}]


@pytest.mark.parametrize(
    "environment",
    first_of([{name: value for each in ENVIRONMENTS for name, value in each.items()}, *ENVIRONMENTS]),
    ids=lambda environment: " ".join(environment),
)
def test_the_users_environment_changes_nothing(
    environment: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log that Zenoh's users switch on, and terminals that cannot show every character."""
    inside = run(tmp_path / "inside", "--in-process", "--set", "run.duration_s=20")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    outside = run(tmp_path / "outside", "--set", "run.duration_s=20", "--record", "off")
    assert outside["valid"]
    assert outside["digest"] == inside["digest"]


SHELL = ["ulimit -Sn 64", "umask 077", "trap '' CHLD", "exec >&- 2>&- <&-"]
BLOCK = "import os, signal; signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())"


@pytest.mark.parametrize("before", first_of(["; ".join(SHELL), *SHELL, "blocked"]))
def test_what_a_shell_passes_on_changes_nothing(before: str, tmp_path: Path) -> None:
    """Closed streams, a low soft limit, files that others cannot read, signals that are ignored or blocked."""
    shorter = ["smoke", "--set", "run.duration_s=20", "--record", "off"]
    inside = run(tmp_path / "inside", "--in-process", *shorter[1:])
    command = [*COMMAND, "run", *shorter, "--out", str(tmp_path / "outside")]
    if before == "blocked":
        command = [sys.executable, "-c", f"{BLOCK}; os.execv({COMMAND[0]!r}, {command})"]
    else:
        command = ["bash", "-c", f"{before}; {shlex.join(command)}"]
    assert subprocess.run(command, capture_output=True, timeout=PATIENCE_S).returncode == 0
    outside = json.loads((tmp_path / "outside" / "summary.json").read_text())
    assert (outside["valid"], outside["why"], outside["operator_restarts"]) == (True, [], 0)
    assert outside["digest"] == inside["digest"]
