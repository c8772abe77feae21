"""A board's one file: what is wrong with it is said at once, all of it, and nothing is started."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from mcap.reader import make_reader

from deltaswarm_board.__main__ import main, world_config
from deltaswarm_board.bodies import find_body
from deltaswarm_board.bodies.kinematic import KinematicBody
from deltaswarm_board.recording import FrameRecorder
from deltaswarm_board.service import Notifier
from deltaswarm_board.settings import BoardSettings, read_settings
from deltaswarm_wire.checked import SettingsError, load
from deltaswarm_wire.session import Tls
from tests.support.complaints import Printed


def a_file(folder: Path, **table: Any) -> Path:
    file = folder / "board.toml"
    file.write_text(tomli_w.dumps({"id": 3, "air": {"listen": ["tcp/127.0.0.1:0"]}, **table}))
    return file


def secret(folder: Path, text: str = "agent-3:word\n", mode: int = 0o600) -> str:
    file = folder / "credentials"
    file.write_text(text)
    file.chmod(mode)
    return str(file)


def test_credentials_log_the_agent_in(tmp_path: Path) -> None:
    """By its own line; the password is in no text that is told."""
    air = {"listen": ["tcp/127.0.0.1:0"], "credentials_file": secret(tmp_path)}
    settings = load(BoardSettings, {"id": 3, "air": air})
    assert ("transport/auth/usrpwd/password", "word") in settings.air.pairs(settings.user)
    assert settings.air.link(settings.user).user == "agent-3"


def test_a_check_says_what_would_be_done_and_does_nothing(tmp_path: Path, capsys: Printed) -> None:
    log = {"folder": str(tmp_path / "logs"), "record": "mcap"}
    assert main([str(a_file(tmp_path, log=log)), "--check"]) == 0
    told = capsys.readouterr().out
    parts = ("agent 3 of run field", "peer, listens on tcp/127.0.0.1:0", "kinematic", "x_m = 0.0, y_m", "as MCAP")
    for part in parts:
        assert part in told
    assert not (tmp_path / "logs").exists()


@pytest.mark.parametrize("body", [{}, {"kind": "kinematic"}])
def test_events_are_beside_the_agents_file(body: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "events.csv").write_text("event,x_m,y_m\n1,2.0,3.0\n")
    file = a_file(tmp_path, body={**body, "options": {"events": "events.csv"}})
    assert main([str(file), "--check"]) == 0
    assert read_settings(file).body.options["events"] == str(tmp_path / "events.csv")
    above = a_file(tmp_path, body={"options": {"events": "/elsewhere/events.csv"}})
    assert read_settings(above).body.options["events"] == "/elsewhere/events.csv"


def test_paths_begin_where_the_agents_file_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wherever one works; and the message about one that is missing says where it was sought."""
    for name in ("keys", "boards", "elsewhere"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    file = a_file(tmp_path / "boards", air={"connect": ["tcp/h:1"], "credentials_file": "../keys/credentials"})
    with pytest.raises(SettingsError, match=f"{tmp_path}/boards/../keys/credentials"):
        read_settings(file)
    secret(tmp_path / "keys")
    assert read_settings(file).air.link("agent-3").password == "word"
    monkeypatch.chdir(tmp_path)
    assert read_settings(Path("boards/board.toml")).air.link("agent-3").password == "word"


def test_events_of_a_spreadsheet_are_read(tmp_path: Path) -> None:
    """Which begins "CSV UTF-8" with a byte order mark, that no one would see in a message about the columns."""
    (tmp_path / "events.csv").write_text("event,x_m,y_m\r\n1,2.0,3.0\r\n", "utf-8-sig")
    assert main([str(a_file(tmp_path, body={"options": {"events": "events.csv"}})), "--check"]) == 0


def test_options_of_another_package_are_its_own(tmp_path: Path) -> None:
    file = a_file(tmp_path, body={"kind": "rover:Rover", "options": {"events": "all"}})
    assert read_settings(file).body.options == {"events": "all"}


def test_a_real_body_has_real_time(tmp_path: Path, capsys: Printed) -> None:
    file = str(a_file(tmp_path, body={"kind": "mavlink"}))
    assert main([file, "--check"]) == 0
    assert main([file, "--check", "--accelerate", "2"]) == 2
    assert "MavlinkBody" in capsys.readouterr().err


@pytest.mark.parametrize("option", [("--steps", "3"), ("--accelerate", "2")])
def test_a_body_of_a_world_has_the_worlds_time(option: tuple[str, str], tmp_path: Path, capsys: Printed) -> None:
    air = {"mode": "client", "connect": ["tcp/10.0.0.1:7447"], "credentials_file": secret(tmp_path)}
    file = str(a_file(tmp_path, air=air, body={"kind": "world"}))
    assert main([file, "--check"]) == 0
    assert main([file, "--check", *option]) == 2
    assert "leave out --steps and --accelerate" in capsys.readouterr().err


def test_the_worlds_body_is_an_agent_of_a_simulation(tmp_path: Path) -> None:
    air = {"mode": "client", "connect": ["tcp/10.0.0.1:7447"], "credentials_file": secret(tmp_path)}
    config = world_config(read_settings(a_file(tmp_path, air=air, body={"kind": "world"}, agent={"seed": 5})))
    assert (config.agent, config.run, config.settings.seed) == (3, "field", 5)
    assert (config.link.endpoint, config.link.user, config.link.password) == ("tcp/10.0.0.1:7447", "agent-3", "word")


def test_an_agent_of_a_simulation_may_come_by_its_certificate(tmp_path: Path) -> None:
    files = {name: secret(tmp_path) for name in ("ca_file", "cert_file", "key_file")}
    air = {"mode": "client", "connect": ["tls/10.0.0.1:7448"], "tls": files}
    config = world_config(read_settings(a_file(tmp_path, air=air, body={"kind": "world"})))
    assert config.link.tls == Tls(files["ca_file"], files["cert_file"], files["key_file"])


def test_a_body_is_found_by_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "rover-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: rover\nVersion: 1.0\n")
    kinematic = "deltaswarm_board.bodies.kinematic:KinematicBody"
    (folder / "entry_points.txt").write_text(f"[deltaswarm.bodies]\nrover = {kinematic}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert find_body("rover") is KinematicBody
    with pytest.raises(SettingsError, match="rover"):
        find_body("rovre")


def test_a_recording_is_bounded(tmp_path: Path) -> None:
    """The newest file and those before it, whose numbers rise, hold the last samples in order; older ones are gone."""
    recorder = FrameRecorder(tmp_path, "agent-3", 10_000, backups=2)
    for number in range(1000):
        recorder.write("/agent/3/radio", number.to_bytes(4) * 8)
    recorder.close()
    older = sorted(tmp_path.glob("agent-3.*.mcap"), key=lambda file: int(file.name.split(".")[1]))
    files = [*older, tmp_path / "agent-3.mcap"]
    assert sorted(tmp_path.iterdir()) == sorted(files)
    assert len(older) == 2
    numbers = []
    for file in files:
        assert file.stat().st_size < 15_000
        with file.open("rb") as stream:
            messages = list(make_reader(stream).iter_messages())
        assert {channel.topic for _, channel, _ in messages} <= {"/agent/3/radio"}
        numbers += [int.from_bytes(message.data[:4]) for _, _, message in messages]
    assert numbers == list(range(numbers[0], 1000))


def test_a_recording_outlives_restarts_that_record_nothing(tmp_path: Path) -> None:
    """As when a controller fails at each start, and the service is started again every two seconds."""
    recorder = FrameRecorder(tmp_path, "agent-3", 10_000, backups=2)
    recorder.write("/agent/3/radio", bytes(8000))
    recorder.close()
    flight = (tmp_path / "agent-3.mcap").read_bytes()
    for _ in range(20):
        FrameRecorder(tmp_path, "agent-3", 10_000, backups=2).close()
    assert (tmp_path / "agent-3.1.mcap").read_bytes() == flight
    for _ in range(100):
        FrameRecorder(tmp_path, "agent-3", 10_000, backups=2).close()
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) < 3 * 11_000


def test_a_recording_whose_next_file_cannot_be_opened_can_be_closed(tmp_path: Path) -> None:
    """At the end of the board, after it was told why nothing is recorded any more."""
    recorder = FrameRecorder(tmp_path / "logs", "agent-3", 100, backups=1)
    shutil.rmtree(tmp_path / "logs")
    with pytest.raises(OSError, match="No such file"):
        recorder.write("/agent/3/radio", bytes(200))
    recorder.close()


def test_without_systemd_nothing_is_told() -> None:
    """And the watchdog is another process's where its number is not ours."""
    quiet = Notifier.from_environment({"WATCHDOG_USEC": "1000000", "WATCHDOG_PID": "1"})
    assert quiet.alive_every_s is None
    for tell in (quiet.ready, quiet.alive, quiet.stopping, quiet.close):
        tell()
    assert Notifier.from_environment({"WATCHDOG_USEC": "1000000"}).alive_every_s == 0.5
    lost = Notifier("/no/such/socket", 1.0)
    lost.alive()
    lost.close()


def test_a_board_needs_neither_pymavlink_nor_mcap(tmp_path: Path) -> None:
    """They are imported when the file asks for them, and where they are missing that is said; exit code 2."""
    program = """
import sys
sys.modules["pymavlink"] = sys.modules["mcap"] = None
from deltaswarm_board.__main__ import main
sys.exit(main([sys.argv[1], "--check"]))
"""
    for table, code, word in (
        ({}, 0, ""),
        ({"body": {"kind": "mavlink"}}, 2, "needs pymavlink: pip install"),
        ({"log": {"record": "mcap", "folder": str(tmp_path / "logs")}}, 2, "needs mcap: pip install"),
    ):
        command = [sys.executable, "-c", program, str(a_file(tmp_path, **table))]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert word in done.stderr


def test_with_revoked_certificates_a_board_in_open_air_names_whom_it_admits(tmp_path: Path) -> None:
    """Without its rules the list would count for nothing; in a simulation the world has them."""
    tls = {name: secret(tmp_path) for name in ("ca_file", "cert_file", "key_file")}
    air = {"listen": ["tls/0.0.0.0:7448"], "tls": tls}
    assert read_settings(a_file(tmp_path, air=air)).air.agents == ""
    (tmp_path / "revoked.txt").write_text("agent-4\n")
    with pytest.raises(SettingsError, match=r"air\.agents must name"):
        read_settings(a_file(tmp_path, air=air))
    pairs = dict(read_settings(a_file(tmp_path, air=air | {"agents": "3-4"})).pairs)
    names = {name for one in pairs["access_control"]["subjects"] for name in one["cert_common_names"]}
    assert {"agent-3", "agent-4.2"} <= names
    assert "agent-4" not in names
    world = {"mode": "client", "connect": ["tls/10.0.0.1:7448"], "tls": tls}
    read_settings(a_file(tmp_path, air=world, body={"kind": "world"}))
    for line in ("agent-", "agent-x", "nobody", "agent-3.", "agent-3.x", "agent-3 # lost"):
        (tmp_path / "revoked.txt").write_text(f"agent-4\n\n{line}\n")
        with pytest.raises(SettingsError, match=r"revoked\.txt line 3 must be a name"):
            read_settings(a_file(tmp_path, air=air | {"agents": "3-4"}))
    (tmp_path / "revoked.txt").write_bytes(b"\xff\xfe")
    with pytest.raises(SettingsError, match=r"revoked\.txt cannot be read"):
        read_settings(a_file(tmp_path, air=air | {"agents": "3-4"}))
