"""Runs that are cut off and go on from their newest checkpoint: kill -9 of everything, Ctrl-C, a world that dies."""

import itertools
import json
import os
import re
import shlex
import shutil
import signal
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import pytest

from deltaswarm_agent.controller import ControllerContext
from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_agent.io import process
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.results.run_tables import read_outcome
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from tests.support.complaints import Printed
from tests.support.swarms import (
    BOUND_S,
    COMMAND,
    UNHURRIED,
    RunningSwarm,
    is_running,
    kill,
    running,
    sets,
    told,
    under_way,
    wait_until,
)

pytestmark = pytest.mark.processes

SETTINGS = (
    "run.duration_s=300",
    "radio.loss=0.1",
    "uplink.latency_s=2",
    "downlink.latency_s=3",
    'command=[{at_s=60, name="set delta", arguments={delta=1}}, {at_s=140, name="hold", arguments={for_s=40}}]',
    "operator.person.policy=threshold",
    'fault=[{kind="kill", at_s=130, agents=[1]}, {kind="restart", at_s=110, duration_s=30, agents=[2]},'
    '{kind="sensor-noisy", at_s=150, duration_s=100, noise_m=1.0, miss=0.3, agents=[4]}]',
)
SETS = sets(*SETTINGS)


def resuming(out: Path) -> AbstractContextManager[RunningSwarm]:
    return under_way(out, *COMMAND, "run", "--resume", str(out.with_name(out.name + ".part")))


def newest(swarm: RunningSwarm) -> int:
    """The step of the newest checkpoint; -1 without one."""
    try:
        return newest_in(swarm.part)
    except FileNotFoundError:
        return -1


def newest_in(folder: Path) -> int:
    return int(json.loads((folder / "checkpoint" / "newest.json").read_text())["step"])


def kill_after_a_checkpoint(swarm: RunningSwarm, before: int, steps: int = 0, *, all_of_it: bool = True) -> None:
    """So many steps after one that is newer than this; all of the run, or its orchestrator alone."""
    wait_until(lambda: newest(swarm) > before or swarm.process.poll() is not None, "a checkpoint")
    swarm.wait_for_steps(steps)
    if all_of_it:
        kill_all(swarm)
    else:  # the others end a little later by themselves
        os.killpg(swarm.process.pid, signal.SIGKILL)
        swarm.process.communicate()


def kill_all(swarm: RunningSwarm) -> None:
    """As when the power goes."""
    pids = swarm.pids
    os.killpg(swarm.process.pid, signal.SIGKILL)
    kill(pids.values())
    wait_until(lambda: not any(map(is_running, pids.values())), "the end of all")
    swarm.process.communicate()


def same_as_undisturbed(swarm: RunningSwarm) -> None:
    """Digest, tables and recording are those of a run that nobody cut off."""
    undisturbed = run_in_process(load_scenario("smoke", SETTINGS))
    assert swarm.summary()["digest"] == undisturbed.digest
    assert swarm.summary()["valid"]
    kept, recorded = read_outcome(swarm.out), read_recording(swarm.out / "recording.mcap")
    for found in (kept, recorded):
        assert found.step_records == undisturbed.step_records
        assert [count._replace(backlog=0) for count in found.workloads] == undisturbed.workloads
        assert sorted(found.events) == sorted(undisturbed.events)
    assert recorded.complete


@pytest.mark.slow
def test_a_run_survives_that_all_is_killed_five_times(tmp_path: Path) -> None:
    """World, operator, agents, recorder and orchestrator, at any moment after another checkpoint."""
    with running(tmp_path / "run", "--checkpoint", "30", *SETS, *UNHURRIED) as swarm:
        kill_after_a_checkpoint(swarm, -1)
    for life in range(4):
        with resuming(swarm.out) as swarm:
            kill_after_a_checkpoint(swarm, newest(swarm), 10 * life, all_of_it=life != 2)
    with resuming(swarm.out) as swarm:
        swarm.end_well()
    assert len(swarm.manifest()["resumed"]) == 5
    same_as_undisturbed(swarm)
    left = {path.name for path in swarm.out.iterdir()}
    assert left == {
        "actions.csv",
        "agents",
        "commands.csv",
        "commands.toml",
        "event_numbers.csv",
        "events.csv",
        "inbox.csv",
        "layout.json",
        "logs",
        "manifest.json",
        "operator.toml",
        "probes.csv",
        "recording.mcap",
        "scenario.toml",
        "series.csv",
        "summary.json",
    }


@pytest.mark.parametrize("how", [pytest.param("Ctrl-C", marks=pytest.mark.slow), "the world is killed"])
def test_a_run_that_ended_too_early_in_order_goes_on(how: str, tmp_path: Path) -> None:
    """It has its name and its tables, and says how to go on."""
    with running(tmp_path / "run", "--checkpoint", "30", *SETS, *UNHURRIED) as swarm:
        wait_until(lambda: newest(swarm) >= 0, "a checkpoint")
        if how == "Ctrl-C":
            swarm.interrupt()
        else:
            swarm.signal("world", signal.SIGKILL)
        code, _, errors = swarm.finish()
        assert code == (130 if how == "Ctrl-C" else 1)
        (advice,) = [line.partition("checkpoint: ")[2] for line in errors.splitlines() if "to go on from" in line]
        assert not swarm.summary()["complete"]
    assert re.search(rf"checkpoint .*step {newest_in(swarm.out)}\b", told("info", str(swarm.out)).stdout)
    program, *words = shlex.split(advice)
    assert program == "deltaswarm"
    process = told(*words)
    assert process.returncode == 0, process.stderr
    same_as_undisturbed(swarm)


@pytest.mark.slow
def test_a_controller_that_cannot_be_saved_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the reason; without checkpoints it may hold what it likes."""
    (tmp_path / "holder.py").write_text(
        "from deltaswarm_agent.controllers.potential import PotentialController\n"
        "class Holder(PotentialController):\n"
        "    def __init__(self, context):\n"
        "        super().__init__(context)\n"
        "        self.kept = lambda: None\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    holder = ["run", "smoke", "--set", "control={mode='holder:Holder'}", "--set", "run.duration_s=20"]
    process = told(*holder, "--checkpoint", "5", "--out", str(tmp_path / "run"))
    assert process.returncode == 1
    assert "holder:Holder" in process.stderr
    assert "Traceback" not in process.stderr
    process = told(*holder, "--out", str(tmp_path / "other"))
    assert process.returncode == 0, process.stderr


def test_an_agent_that_never_saves_itself_costs_little(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It acts in time; each of ten checkpoints would wait for it as long as for a start."""
    (tmp_path / "forgetful.py").write_text(
        "import deltaswarm_agent.io.process\n"
        "from deltaswarm_agent.controllers.potential import PotentialController\n"
        "class Forgetful(PotentialController):\n"
        "    def __init__(self, context):\n"
        "        super().__init__(context)\n"
        "        if context.agent == 3:\n"
        "            deltaswarm_agent.io.process._save = lambda *_: None\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    settings = sets("control={mode='forgetful:Forgetful'}", "run.duration_s=50", "run.step_timeout_s=1")
    began = time.monotonic()
    with running(tmp_path / "run", *settings, "--checkpoint", "5") as swarm:
        swarm.end_well()
    assert time.monotonic() - began < BOUND_S
    assert "agent 3 did not save itself" in swarm.log("world")
    assert not swarm.summary()["agents_lost"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--resume", "nowhere"], "nowhere"),
        (["--resume", "nowhere", "--seed", "3"], "without --seed"),
        (["smoke", "--checkpoint", "5", "--in-process"], "--in-process must be given without --checkpoint"),
        (["smoke", "--checkpoint", "0"], "--checkpoint: must be an integer from 1 to 1000000000 (got '0')"),
    ],
)
def test_what_cannot_be_resumed_or_saved_is_refused(arguments: list[str], said: str, capsys: Printed) -> None:
    """One line, exit code 2."""
    try:
        code = main(["run", *arguments])
    except SystemExit as end:
        code = int(end.code or 0)
    assert code == 2
    assert said in capsys.readouterr().err


def test_a_run_without_a_checkpoint_or_of_other_code_stays_as_it_is(tmp_path: Path, capsys: Printed) -> None:
    """Nothing in its folder is touched."""
    run = tmp_path / "run"
    assert main(["run", "smoke", "--in-process", "--set", "run.duration_s=20", "--out", str(run)]) == 0
    capsys.readouterr()
    names = sorted(path.name for path in run.iterdir())
    assert main(["run", "--resume", str(run)]) == 2
    assert "no checkpoint" in capsys.readouterr().err
    (run / "checkpoint").mkdir()
    (run / "checkpoint" / "newest.json").write_text('{"step": 9, "agents": [0], "restarts": []}')
    manifest = json.loads((run / "manifest.json").read_text())
    (run / "manifest.json").write_text(json.dumps(manifest | {"code": "another"}))
    assert main(["run", "--resume", str(run)]) == 2
    assert "manifest.json was changed or damaged" in capsys.readouterr().err
    seal.write_sealed(run / "manifest.json", manifest | {"code": "another"}, {})
    assert main(["run", "--resume", str(run)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "with other versions of" in line
    assert str(run) in line
    assert sorted(path.name for path in run.iterdir()) == sorted([*names, "checkpoint"])


@pytest.fixture(scope="module")
def cut_off(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run that was killed after a checkpoint."""
    out = tmp_path_factory.mktemp("cut off") / "run"
    with running(out, "--checkpoint", "50", "--set", "run.duration_s=20000") as swarm:
        kill_after_a_checkpoint(swarm, -1, 10)
        wait_until(lambda: not any(map(is_running, swarm.pids.values())), "the end of all")
    return swarm.part


def flip(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def another_digit(data: bytes) -> bytes:
    """In the table's second row, which still reads as well."""
    head, second, rest = data.split(b"\n", 2)
    return b"\n".join([head, second.translate(bytes.maketrans(b"0123456789", b"1234567890")), rest])


def empty(data: bytes) -> bytes:
    return b""


def gone(data: bytes) -> None:
    return None


CHECKPOINT = [f"checkpoint/{{step}}/{name}" for name in ("operator.json", "agent-3.pickle", "world.pickle")]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        *itertools.product(["manifest.json", "world.csv", "checkpoint/newest.json", *CHECKPOINT], [empty, gone]),
        *itertools.product(CHECKPOINT, [flip]),
        ("checkpoint/newest.json", lambda data: data.replace(b'"restarts": []', b'"restarts": [[3, 1]]')),
        ("world.csv", another_digit),
        ("operator.csv", another_digit),
        ("scenario.toml", lambda data: data.replace(b"seed = ", b"seed = 1")),
        ("scenario.toml", lambda data: data.replace(b"loss = 0.0", b"loss = 0.5")),
        ("scenario.toml", lambda data: data.replace(b"step_timeout_s = 5", b"step_timeout_s = 6")),
    ],
)
def test_a_damaged_or_changed_input_is_refused_in_a_line(
    name: str, change: Callable[[bytes], bytes | None], cut_off: Path, tmp_path: Path, capsys: Printed
) -> None:
    """It names the file, though some could be read all the same, and leaves all others: the file may come back."""
    run = shutil.copytree(cut_off, tmp_path / "run.part", ignore=shutil.ignore_patterns("*.sock"))
    file = run / name.format(step=newest_in(run))
    before = file.read_bytes()
    if (changed := change(before)) is None:
        file.unlink()
    else:
        file.write_bytes(changed)
    assert changed != before
    names = sorted(path.name for path in run.rglob("*"))
    capsys.readouterr()
    assert main(["run", "--resume", str(run)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(file) in line or (change, name) == (gone, "checkpoint/newest.json")
    assert sorted(path.name for path in run.rglob("*")) == names


def test_an_agent_that_only_says_that_it_is_saved_completes_no_checkpoint(tmp_path: Path) -> None:
    """What is not on the disk is not there: the run goes on without the checkpoint, and the log names the agent."""
    control = ("--set", "control.mode=tests.processes.test_resume:Liar")
    with running(tmp_path / "run", "--checkpoint", "50", "--set", "run.duration_s=120", *control) as swarm:
        swarm.end_well()
    assert "agent 3 did not save itself" in swarm.log("world")


class Liar(PaperController):
    """Agent 3 confirms each checkpoint and never writes one."""

    def __init__(self, context: ControllerContext) -> None:
        super().__init__(replace(context, mode="hybrid", settings=PaperSettings()))
        if context.agent == 3:
            process.save_part = lambda *_: None  # in this agent's own process
