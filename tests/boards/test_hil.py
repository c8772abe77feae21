"""Hardware in the loop on loopback: some agents are boards, and may be late, leave and come back."""

import os
import re
import signal
import socket
from collections.abc import Sequence
from pathlib import Path

import pytest
import tomli_w

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.processes import certificates
from deltaswarm_orchestrator.processes.boards import Boards, authority_folder, commands
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.checked import SettingsError
from tests.support.cable import cable
from tests.support.complaints import Printed, names
from tests.support.fields import boards
from tests.support.loops import loop, mode
from tests.support.swarms import PATIENCE_S, run, running, wait_until
from tests.support.tiers import first_of

BOARDS = (4, 5)
"""The last two of the scenario `smoke`."""

SHORT = ("--set", "run.duration_s=60", "--record", "off")
REAL = ("--record", "off", "--set", "run.clock=realtime", "--set", "run.real_time_factor=20")
LONG = ("--set", "run.duration_s=1000000")
"""A run that a test ends once it has seen what it is about."""

ACCEPTED = ("--set", f"run.accept_lost={len(BOARDS)}")
"""A run in which boards may be late or away."""

TALKATIVE = [f"--set={name}" for name in ("events.rate_hz=5", "agents.sensing_range_m=60", "radio.range_m=60")]
"""There is always an event, which all sense, so that all have something to say in each step."""


@pytest.mark.processes
@pytest.mark.parametrize("listen", first_of(["tls/127.0.0.1:0", "tcp/127.0.0.1:0"]))
def test_boards_are_agents_of_the_run(listen: str, tmp_path: Path) -> None:
    """Over TCP by password and over TLS by certificate: the digest is that of the run in one process."""
    same = [*SHORT, "--set", "run.ask_every_step=true"]  # as boards are
    with loop(tmp_path, BOARDS, "--listen", listen, *same) as made:
        secrets = [f"agent-{board}.{'key' if listen.startswith('tls') else 'password'}" for board in BOARDS]
        assert [mode(made.folder / secret) for secret in secrets] == [0o600] * len(BOARDS)
        for board in BOARDS:
            made.start(board)
        summary = made.finish()
    assert summary["digest"] == run(tmp_path / "inside", "--in-process", *same)["digest"]
    calm = {"late_steps": 0, "absences": 0, "absent_steps": 0}
    assert summary["boards"] == {str(board): calm for board in BOARDS}


@pytest.mark.processes
def test_systemd_is_told_and_its_log_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent of a world may run under the same unit: ready, alive all the time, stopping."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd, loop(tmp_path, (5,), *SHORT) as made:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "20000")
        logs = {"folder": str(tmp_path / "logs")}
        (made.folder / "5.toml").write_text(tomli_w.dumps({**made.settings(5), "log": logs}))
        made.start(5)
        told = [systemd.recv(1000).decode()]
        while told[-1] != "STOPPING=1":
            told.append(systemd.recv(1000).decode())
        made.finish()
    assert told.count("READY=1") == 1
    assert "WATCHDOG=1" in told
    assert "agent 5 is ready" in (tmp_path / "logs" / "agent-5.log").read_text()


@pytest.mark.processes
@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGTERM, signal.SIGHUP]))
def test_a_board_that_waits_for_a_mute_world_can_be_stopped(number: signal.Signals, tmp_path: Path) -> None:
    """Whoever takes its connection and says nothing keeps it from nothing."""
    with socket.create_server(("127.0.0.1", 0)) as mute, boards(tmp_path) as started:
        air = {"mode": "client", "connect": [f"tcp/127.0.0.1:{mute.getsockname()[1]}"]}
        process = started.start({"id": 5, "air": air, "body": {"kind": "world"}})
        with mute.accept()[0] as link:
            link.recv(1)
            process.send_signal(number)
            assert process.wait(PATIENCE_S) == -number


@pytest.mark.processes
def test_a_board_may_stand_still_or_be_started_anew(tmp_path: Path) -> None:
    """It is late or absent, others are not, and the run is valid, however many frames it answers at once."""
    with loop(tmp_path, BOARDS, *REAL, "--set", "run.step_timeout_s=0.5", *TALKATIVE, *LONG, *ACCEPTED) as made:
        for board in BOARDS:
            made.start(board)
        made.swarm.wait_for_steps(1)
        os.kill(made.processes[5].pid, signal.SIGSTOP)
        made.kill(4)
        made.wait_for_the_world("agent 4 is gone")
        made.wait_for_the_world("continues without agent 5")
        made.swarm.wait_for_steps(40)  # 2 s: it gets a frame in each half second
        os.kill(made.processes[5].pid, signal.SIGCONT)
        made.start(4)
        made.wait_for_the_world("agent 4 is back")
        made.wait_for_the_world("agent 5, which hung, answers")
        summary = made.stop()
    found = summary["boards"]
    assert found["4"]["absences"] == 1
    assert found["4"]["absent_steps"] > 0
    assert found["5"]["late_steps"] > 0
    assert found["5"]["absences"] == 0
    assert (summary["valid"], summary["agents_lost"], summary["transport_lost"]) == (True, [], 0)


@pytest.mark.processes
def test_a_board_that_is_there_twice_is_named(tmp_path: Path) -> None:
    """The run is not valid, and says of which agent there may be two."""
    with loop(tmp_path, BOARDS, *REAL, *LONG, "--set", "run.real_time_factor=100") as made:
        made.start(4)
        made.start(5)
        made.swarm.wait_for_steps(1)
        made.processes[-5] = made.processes[5]
        made.start(5)
        wait_until(lambda: made.said(5).count("is ready") == 2, "the second process is there")
        made.swarm.wait_for_steps(600)
        reasons = made.stop()["invalid_because"]
    assert any("agent 5" in reason and "two processes" in reason for reason in reasons)
    assert "agent 4" not in " ".join(reasons)


@pytest.mark.processes
def test_a_board_whose_link_was_cut_goes_on(tmp_path: Path) -> None:
    """The same process comes back, and what it said meanwhile is no loss of the fabric."""
    with loop(tmp_path, BOARDS, *REAL, *LONG, *ACCEPTED) as made:
        endpoint = made.settings(4)["air"]["connect"][0]
        with cable(int(endpoint.rpartition(":")[2])) as link:
            made.start(4, connect=[f"tcp/127.0.0.1:{link.port}"])
            made.start(5)
            made.swarm.wait_for_steps(1)
            link.cut()
            made.wait_for_the_world("agent 4 is gone")
            made.swarm.wait_for_steps(1)
            link.mend()
            made.wait_for_the_world("agent 4 is back")
            made.swarm.wait_for_steps(1)
            summary = made.stop()
        assert made.said(4).count("is ready") == 1
    assert summary["boards"]["4"]["absences"] == 1
    assert summary["boards"]["5"]["absences"] == 0
    assert (summary["invalid_because"], summary["transport_lost"], summary["agents_lost"]) == ([], 0, [])


@pytest.mark.processes
def test_a_board_started_anew_behind_a_dead_link_is_found(tmp_path: Path) -> None:
    """Its old link has not been given up yet, so its token never went: it gets a frame all the same."""
    with loop(tmp_path, BOARDS, *REAL, "--set", "run.step_timeout_s=0.5", *LONG) as made:
        endpoint = made.settings(4)["air"]["connect"][0]
        with cable(int(endpoint.rpartition(":")[2])) as link:
            made.start(4, connect=[f"tcp/127.0.0.1:{link.port}"])
            made.start(5)
            made.swarm.wait_for_steps(1)
            link.hold()
            made.wait_for_the_world("continues without agent 4")
            made.kill(4)
            made.start(4, connect=[endpoint])
            made.wait_for_the_world("agent 4, which hung, answers")
            assert made.said(4).count("is ready") == 2
            summary = made.stop()
            assert " after step " in made.said(4)
    assert summary["boards"]["4"]["late_steps"] > 0
    assert [row["agent"] for row in summary["agents_hung"]] == [4]
    assert all(reason.startswith("agent 4 ") for reason in summary["invalid_because"])


@pytest.mark.processes
def test_the_run_says_for_which_boards_it_waits(tmp_path: Path) -> None:
    """By its commands at once, and by their numbers when it gives up."""
    with running(tmp_path / "run", "--boards", "4-5", "--set", "run.start_timeout_s=12", *SHORT) as swarm:
        code, _, errors = swarm.finish()
    assert code == 1
    assert "deltaswarm-agent board 4.toml" in errors
    assert re.search(r"\b12 s\b.*agent 4, agent 5", errors)  # on a slow machine others, too


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--boards", "4-6"], "--boards: (got 6)"),
        (["--boards", "4", "--listen", "tcp/0.0.0.0:7447"], "--listen: tcp/0.0.0.0:7447"),
        (["--boards", "4", "--listen", "unixsock-stream//tmp/world"], "--listen: unixsock-stream//tmp/world"),
        (["--boards", "4", "--listen", "tls/[::1]:7447"], "--listen: tls/[::1]:7447"),
        (["--boards", "4", "--in-process"], "--in-process: --boards"),
        (["--boards-folder", "there"], "--boards-folder: --boards"),
    ],
)
def test_what_cannot_be_is_refused(arguments: Sequence[str], message: str, tmp_path: Path, capsys: Printed) -> None:
    assert main(["run", "smoke", "--out", str(tmp_path / "run"), *arguments]) == 2
    assert names(capsys.readouterr().err, message)
    assert list(tmp_path.iterdir()) == []


def test_faults_that_need_all_processes_are_refused(tmp_path: Path) -> None:
    scenario = load_scenario("smoke", ['fault=[{kind="kill", at_s=10, agents=[1]}]'])
    with pytest.raises(SettingsError, match=r"^fault\.0\.kind .*'kill'"):
        Boards((4,), "tcp/127.0.0.1:0", tmp_path).prepare(scenario)


def secrets_in(folder: Path) -> set[str]:
    return {file.name for file in folder.glob("*.key")}


def test_the_authoritys_key_is_not_among_what_boards_are_given(tmp_path: Path) -> None:
    """Nor is the world's, which stands beside it in a folder for its owner alone; the next run signs with the same."""
    scenario = load_scenario("smoke", [])
    made = Boards(BOARDS, "tls/127.0.0.1:0", tmp_path / "boards")
    made.prepare(scenario)
    kept = authority_folder(made.folder)
    assert made.folder not in (kept, *kept.parents)
    assert secrets_in(made.folder) == {"agent-4.key", "agent-5.key"}
    assert {"ca.key", "world.key"} <= secrets_in(kept)
    assert (mode(kept), mode(kept / "ca.key"), mode(made.folder / "agent-4.key")) == (0o700, 0o600, 0o600)
    assert str(kept / "ca.key") in commands([made.folder / "4.toml"])
    before = {file.name: file.read_bytes() for file in made.folder.iterdir()}
    Boards((4,), "tls/127.0.0.1:0", made.folder).prepare(scenario)
    assert {file.name: file.read_bytes() for file in made.folder.iterdir()} == before


def test_an_authority_among_what_boards_are_given_is_moved_away(tmp_path: Path) -> None:
    """One that `deltaswarm certificates` made there; what boards have from it is good as before."""
    certificates.make(tmp_path / "boards", [4], [], 30)
    before = (tmp_path / "boards" / "agent-4.pem").read_bytes()
    made = Boards(BOARDS, "tls/127.0.0.1:0", tmp_path / "boards")
    made.prepare(load_scenario("smoke", []))
    assert secrets_in(made.folder) == {"agent-4.key", "agent-5.key"}
    assert (made.folder / "agent-4.pem").read_bytes() == before
