"""A board's file that is wrong, broken or hostile: a line says what is wrong, nothing hangs, no other code runs."""

import copy
import datetime
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from deltaswarm_board.__main__ import main
from deltaswarm_board.bodies import find_body
from deltaswarm_board.settings import MAX_FILE_BYTES
from deltaswarm_operator.__main__ import main as operator_main
from deltaswarm_orchestrator.processes import certificates
from deltaswarm_orchestrator.processes.certificates import Authority
from deltaswarm_wire.checked import SettingsError
from tests.support.boards import tls_arguments
from tests.support.complaints import Printed

AIR = {"listen": ["tcp/127.0.0.1:0"], "connect": ["tcp/127.0.0.1:1"]}
WHOLE: dict[str, Any] = {
    "id": 3,
    "run": "field",
    "agent": {"step_s": 1.0, "control": {"mode": "hybrid", "delta": 3}},
    "air": {**AIR, "agents": "", "credentials_file": "", "tls": {"ca_file": ""}, "zenoh": {"a/b": "1"}},
    "body": {"kind": "kinematic", "options": {"events": "", "x_m": 1.0}},
    "log": {"folder": "", "max_bytes": 100_000, "record": "off"},
}
LONG = "x" * 200_000
DEEP: list[Any] = []
for _ in range(200):
    DEEP = [DEEP]
NASTY: list[Any] = [
    *(
        True,
        -1,
        2**70,
        1.5,
        float("nan"),
        float("inf"),
        "",
        "\0",
        "a/b",
        "../../etc/passwd",
        "/dev/zero",
        "/",
        "é" * 50,
    ),
    *(LONG, [LONG], {LONG: 1}, "\n\x1b[31mred", "os:system", "x:y", [], [1], ["\0"], [["a"]], DEEP, {}, {"": {}}),
    *(datetime.date(2020, 1, 1), datetime.datetime(2020, 1, 1), datetime.time(1)),
]
MAX_SHOWN = 4000
"""Characters of a line that says what is wrong, beside its file's name."""


def places(table: dict[str, Any], above: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found = []
    for name, value in table.items():
        found += [(*above, name), *(places(value, (*above, name)) if isinstance(value, dict) else [])]
    return found


def check(file: Path, capsys: Printed) -> tuple[int, str]:
    """Exit code, and what is said, of which each line can be read."""
    code = main([str(file), "--check"])
    said = capsys.readouterr().err
    for line in said.splitlines():
        assert len(line) <= len(str(file)) + MAX_SHOWN, line[:200]
        assert line.isprintable()
        assert line.startswith(str(file))
    return code, said


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that boards' files name: certificates, one of them expired, and credentials, good and bad."""
    made = tmp_path_factory.mktemp("boards")
    certificates.make(made, [3, 4], [], 1)
    certificates.write_pair(made / "expired", *Authority.load(made).sign("agent-3", days=-1 / 24))
    certificates.make(made / "elsewhere", [3], [], 1)
    for name, text, mode in (
        ("good", "agent-3:word\n", 0o600),
        ("group", "agent-3:word\n", 0o640),
        ("all", "agent-3:word\n", 0o604),
        ("other", "agent-4:word\n", 0o600),
    ):
        (made / name).write_text(text)
        (made / name).chmod(mode)
    return made


def tls(certificate: str = "agent-3", key: str = "", **more: bool) -> dict[str, Any]:
    return {"ca_file": "ca.pem", "cert_file": f"{certificate}.pem", "key_file": f"{key or certificate}.key", **more}


def listens(endpoint: str = "tls/127.0.0.1:1", **air: Any) -> dict[str, Any]:
    return {"air": {"listen": [endpoint], **air}}


def in_a_world(endpoint: str = "tls/10.0.0.1:7448", **air: Any) -> dict[str, Any]:
    return {"body": {"kind": "world"}, "air": {"mode": "client", "connect": [endpoint], "tls": tls(), **air}}


def body(kind: str, **options: Any) -> dict[str, Any]:
    return {"body": {"kind": kind, "options": options}}


WRONG: list[tuple[dict[str, Any], Sequence[str]]] = [
    # Each mistake is told, with its key, what must hold, and what was found.
    (
        {
            "id": 70_000,
            "agnet": {},
            "agent": {"step_s": 0, "control": {"mode": "hybird"}},
            "air": {"mode": "client", "listen": ["127.0.0.1"]},
            "body": {"kind": 3},
            "log": {"record": "mcap", "level": "LOUD"},
        },
        (
            r"id must be an integer from 0 to 65534 \(got 70000\)",
            r"agnet: unknown key; did you mean 'agent'\?",
            "agent.step_s must",
            r"\(got 'hybird'; did you mean 'hybrid'\?\)",
            "air.connect must",
            r"\(got 127.0.0.1\)",
            "air.listen must be PROTOCOL/ADDRESS",
            r"body.kind must be a string \(got 3\)",
            "log.level must",
        ),
    ),
    # An unknown key hides no mistake between tables.
    (
        {"agnet": {}, "agent": {"range_m": 5.0, "rnage": 1}, **listens(multi_cast=True), "log": {"lvel": "INFO"}},
        ("agent.control.d_min_m", "agent.rnage", "agnet", "air.multi_cast", "log.lvel"),
    ),
    ({"run": "a/b"}, ["run must"]),
    ({"agent": {"range_m": 5.0}}, ["agent.control.d_min_m must"]),
    ({"log": {"record": "mcap"}}, ["log.record must"]),
    ({"air": {}}, ["air.connect must"]),
    (listens("tls/0.0.0.0:1"), ["certificates in air.tls"]),
    ({"air": {"connect": ["tls/[::1]:1"]}}, ["over TLS"]),
    (listens("tcp/0.0.0.0:1", tls={"ca_file": "/no/ca.pem"}), [r"\(got '/no/ca.pem'\)"]),
    (listens("tcp/0.0.0.0:1", zenoh={"a": 1}), ["air.zenoh.a must"]),
    (listens("tcp/0.0.0.0:1", zenoh={"no/such": "1"}), ["no/such=1"]),
    # Credentials are for their owner alone, and have a line for this agent.
    (listens("tcp/127.0.0.1:0", credentials_file="group"), ["0640"]),
    (listens("tcp/127.0.0.1:0", credentials_file="all"), ["0604"]),
    (listens("tcp/127.0.0.1:0", credentials_file="other"), ["agent-3:PASSWORD"]),
    # The operator's public key has 64 hexadecimal digits.
    ({**listens("tcp/127.0.0.1:0", operator_key="abc")}, ["64"]),
    # The agents that a board admits need certificates, and include itself.
    (listens(agents="3-x", tls=tls()), ["20-24"]),
    (listens(agents="0-2", tls=tls()), ["air.agents must .*3"]),
    (listens(agents="0-3", tls=tls(), connect=["tcp/10.0.0.1:7447"]), ["tls/"]),
    ({"air": {"agents": "0-3", "multicast": True}}, ["air.agents must .*certificates"]),
    # A body and its options.
    ({"body": 1}, ["body"]),
    ({"body": {"kind": [], "options": {}}}, ["body.kind"]),
    ({"body": {"kind": "kinematic", "options": 1}}, ["body.options"]),
    (body("kinematik"), ["kinematic, mavlink, ros2, world, or module:Class"]),
    (body("no_such_module:Body"), ["ModuleNotFoundError"]),
    (body("math:pi"), ["body with Settings"]),
    (body("kinematic", drfit=1), ["body.options.drfit"]),
    (body("mavlink", fence_m=[[0, 0], [1, 1]]), ["body.options.fence_m"]),
    (body("mavlink", fence_m=[[0], [1, 1], [2, 0]]), ["two numbers"]),
    (body("ros2", command="cmd vel"), ["body.options.command must"]),
    ({"body": {"follower": "ros2"}}, ["body.follower must be left out"]),
    # A world takes an agent of a simulation from one endpoint, without what is for open air alone.
    ({"body": {"kind": "world", "follower": "ros"}, "air": AIR}, ["'ros'; did you mean 'ros2'"]),
    ({"body": {"kind": "world"}, **listens("tcp/0.0.0.0:1")}, ["air.connect must"]),
    ({"body": {"kind": "world"}, "log": {"record": "mcap", "folder": "/tmp"}}, ["log.record must"]),
    (in_a_world("quic/10.0.0.1:7448"), ["air.connect must"]),
    (in_a_world(agents="0-3"), ["air.agents must"]),
    (in_a_world(zenoh={"no/such": "1"}), ["no/such"]),
    (in_a_world(tls=tls(verify_name=False)), ["air.tls.verify_name must"]),
    (in_a_world(operator_key="0" * 64), ["air.operator_key must be left out"]),
]
"""Tables besides an agent's number, and what is said of each, as regular expressions."""


def test_what_is_wrong_is_told(folder: Path, capsys: Printed) -> None:
    file = folder / "3.toml"
    for table, words in WRONG:
        file.write_text(tomli_w.dumps({"id": 3, **listens("tcp/127.0.0.1:0"), **table}))
        code, said = check(file, capsys)
        assert (code, main([str(file)])) == (2, 2), table
        assert capsys.readouterr().err == said
        assert not [word for word in words if not re.search(word, said)], (table, said)
        assert len(said.splitlines()) >= len(words), (table, said)


@pytest.mark.parametrize(
    ("certificate", "key", "authority", "word"),
    [
        ("agent-3", "agent-3", "ca.pem", ""),
        ("agent-4", "agent-4", "ca.pem", "agent-4"),
        ("agent-3", "agent-4", "ca.pem", "KEY_VALUES_MISMATCH"),
        ("agent-3", "agent-3", "elsewhere/ca.pem", "other end"),
        ("expired", "expired", "ca.pem", "certificate has expired"),
    ],
)
def test_a_certificate_is_tried_before_it_meets_silence(
    certificate: str, key: str, authority: str, word: str, folder: Path, capsys: Printed
) -> None:
    file = folder / "3.toml"
    table = listens(tls=tls(certificate, key) | {"ca_file": authority})
    file.write_text(tomli_w.dumps({"id": 3, **table}))
    code, said = check(file, capsys)
    assert code == (2 if word else 0), said
    assert word in said


@pytest.mark.parametrize(
    ("name", "text", "word"),
    [
        ("raises", "raise RuntimeError('no licence')", "RuntimeError: no licence"),
        ("no_python", "def (", "SyntaxError"),
        ("empty", "", "AttributeError"),
        ("exits", "class Rover: sense = 1", "Settings, REAL_TIME, move, close"),
        ("plain", "class Rover: Settings = REAL_TIME = sense = move = close = object", "dataclass"),
    ],
)
def test_a_module_that_is_no_body_is_refused(
    name: str, text: str, word: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / f"{name}_body.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(SettingsError, match=word):
        find_body(f"{name}_body:Rover")


def test_a_file_that_is_not_there_or_no_toml(tmp_path: Path) -> None:
    assert main([str(tmp_path / "none.toml")]) == 2
    for data in (b"id = = 3", b"\xff\xfe", b"id = " + b"[" * 10_000):
        (tmp_path / "bad.toml").write_bytes(data)
        assert main([str(tmp_path / "bad.toml")]) == 2


@pytest.mark.parametrize("part", ["id", "run", *(name for name in WHOLE if isinstance(WHOLE[name], dict))])
def test_any_value_anywhere_is_right_or_told(part: str, tmp_path: Path, capsys: Printed) -> None:
    """Wrong types, endless and deep values, devices, NUL and terminal codes: exit code 2 and a line, or nothing."""
    file = tmp_path / "3.toml"
    for place in (place for place in places(WHOLE) if place[0] == part):
        for value in NASTY:
            table = copy.deepcopy(WHOLE)
            inner = table
            for name in place[:-1]:
                inner = inner[name]
            inner[place[-1]] = value
            file.write_text(tomli_w.dumps(table))
            code, said = check(file, capsys)
            assert (code == 2) == bool(said), (place, value, said)


@pytest.mark.parametrize("value", ["." + ".".join("a" * 3000) + " = 1", " = " + "[" * 100_000], ids=["dotted", "lists"])
def test_a_file_that_is_nested_deeply_is_told(value: str, tmp_path: Path, capsys: Printed) -> None:
    file = tmp_path / "3.toml"
    for place in ("x", "air", "air.zenoh", "body.kind", "body.options", "agent.control.options"):
        file.write_text(f"{place}{value}\n")
        assert check(file, capsys)[0] == 2, place


def test_a_file_of_ten_megabytes_is_not_read(tmp_path: Path, capsys: Printed) -> None:
    file = tmp_path / "3.toml"
    file.write_text(f'run = "{"x" * 10_000_000}"\n')
    code, said = check(file, capsys)
    assert code == 2
    assert said.startswith(f"{file}: ")
    assert str(MAX_FILE_BYTES) in said
    assert check(Path("/dev/zero"), capsys)[0] == 2


def test_a_file_that_everybody_may_write_to_is_refused(tmp_path: Path, capsys: Printed) -> None:
    """It names code that runs; that others may read it does not matter, since secrets are in files of their own."""
    file = tmp_path / "3.toml"
    file.write_text(tomli_w.dumps(WHOLE | {"air": AIR}))
    file.chmod(0o644)
    assert check(file, capsys) == (0, "")
    file.chmod(0o646)
    code, said = check(file, capsys)
    assert code == 2
    assert "0646" in said
    assert f"chmod 644 {file}" in said


def test_events_are_read_from_a_file_of_reasonable_size(tmp_path: Path, capsys: Printed) -> None:
    os.mkfifo(tmp_path / "fifo")
    with (tmp_path / "large").open("wb") as large:
        large.truncate(1 << 32)
    file = tmp_path / "3.toml"
    for endless in ("/dev/zero", "fifo", "large"):
        file.write_text(tomli_w.dumps(WHOLE | {"air": AIR, "body": {"options": {"events": endless}}}))
        code, said = check(file, capsys)
        assert code == 2
        assert "body.options.events" in said


def test_no_module_beside_the_file_is_loaded(tmp_path: Path) -> None:
    """As the program runs it, code comes from what is installed and from PYTHONPATH, as a body and as a controller."""
    marker = tmp_path / "loaded"
    (tmp_path / "mine.py").write_text(f"open({str(marker)!r}, 'w')\n")
    for table in ({"body": {"kind": "mine:Body"}}, {"agent": {"control": {"mode": "mine:Controller"}}}):
        file = tmp_path / "3.toml"
        file.write_text(tomli_w.dumps({"id": 3, "air": AIR, **table}))
        command = [sys.executable, "-P", "-m", "deltaswarm_board", str(file), "--check"]
        for path, is_loaded in (("", False), (str(tmp_path), True)):
            environment = {**os.environ, "PYTHONPATH": path}
            done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
            assert done.returncode == 2
            assert marker.exists() == is_loaded
            assert "mine:" in done.stderr
        marker.unlink()


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660], ids=oct)
def test_a_secret_that_others_may_read_is_refused_everywhere(mode: int, tmp_path: Path, capsys: Printed) -> None:
    """A board's key and credentials, and what is given to the operator by argument: in a line, with what to do."""
    certificates.make(tmp_path, [3], [], 1)
    secret = tmp_path / "secret"
    secret.write_text("agent-3:word\noperator:word\n")
    for file in (tmp_path / "agent-3.key", secret, tmp_path / "operator.key"):
        file.chmod(mode)
    for air in (listens("tls/127.0.0.1:0", tls=tls())["air"], {**AIR, "credentials_file": str(secret)}):
        file = tmp_path / "3.toml"
        file.write_text(tomli_w.dumps({"id": 3, "air": air}))
        code, said = check(file, capsys)
        assert code == 2
        assert f"{mode:04o}" in said
        assert "chmod 600" in said
    common = ["--run", "field", "--out", str(tmp_path / "out")]
    for arguments in (
        ["--connect", "tcp/127.0.0.1:1", "--password-file", str(secret)],
        ["--no-world", "--listen", "tcp/127.0.0.1:0", "--credentials", str(secret)],
        ["--no-world", "--listen", "tls/127.0.0.1:0", *tls_arguments(tmp_path, "operator")],
    ):
        assert operator_main([*common, *arguments]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert f"{mode:04o}: chmod 600 " in said
