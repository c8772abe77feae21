"""A hostile or broken board's file: told in a line each, nothing hangs, and nothing runs that it does not name."""

import copy
import datetime
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from deltaswarm_board.__main__ import main
from deltaswarm_board.settings import MAX_FILE_BYTES
from deltaswarm_operator.__main__ import main as operator_main
from deltaswarm_orchestrator.processes import certificates
from tests.support.boards import tls_arguments, tls_table
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
    """Every key, by its path."""
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


@pytest.mark.parametrize("place", places(WHOLE), ids=".".join)
def test_any_value_anywhere_is_right_or_told(place: tuple[str, ...], tmp_path: Path, capsys: Printed) -> None:
    """Wrong types, endless and deep values, devices, NUL and terminal codes: exit code 2 and a line, or nothing."""
    file = tmp_path / "3.toml"
    for value in NASTY:
        table = copy.deepcopy(WHOLE)
        inner = table
        for name in place[:-1]:
            inner = inner[name]
        inner[place[-1]] = value
        file.write_text(tomli_w.dumps(table))
        code, said = check(file, capsys)
        assert (code == 2) == bool(said), (value, said)


@pytest.mark.parametrize("place", ["x", "air", "air.zenoh", "body.kind", "body.options", "agent.control.options"])
@pytest.mark.parametrize("value", ["." + ".".join("a" * 3000) + " = 1", " = " + "[" * 100_000], ids=["dotted", "lists"])
def test_a_file_that_is_nested_deeply_is_told(value: str, place: str, tmp_path: Path, capsys: Printed) -> None:
    """Wherever that is, and in which way."""
    file = tmp_path / "3.toml"
    file.write_text(f"{place}{value}\n")
    assert check(file, capsys)[0] == 2


def test_a_file_of_ten_megabytes_is_not_read(tmp_path: Path, capsys: Printed) -> None:
    """Nor an endless one."""
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


@pytest.mark.parametrize("endless", ["/dev/zero", "fifo", "large"])
def test_events_are_read_from_a_file_of_reasonable_size(endless: str, tmp_path: Path, capsys: Printed) -> None:
    """No device, nobody's pipe, nothing that fills the memory."""
    os.mkfifo(tmp_path / "fifo")
    with (tmp_path / "large").open("wb") as large:
        large.truncate(1 << 32)
    file = tmp_path / "3.toml"
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
    tls = tls_table(tmp_path, "agent-3")
    for air in ({"listen": ["tls/127.0.0.1:0"], "tls": tls}, {**AIR, "credentials_file": str(secret)}):
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
