"""Paths and ports that a user gives: what is no file, cannot be written or is taken is refused before anything runs."""

import os
import socket
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.paths import check_out
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test

SWEEP = ("sweep", "smoke", "--repeats", "1", "--prove", "0", "--out", "OUT")


@pytest.mark.parametrize(
    "command",
    [
        *(SWEEP, ("report", "OUT"), ("study", "paper", "--render", "--out", "OUT"), ("run", "--resume", "OUT")),
        *(("info", "OUT"), ("why", "OUT"), ("export", "OUT", "--format", "csv"), ("replay", "OUT"), ("value", "OUT")),
        *(("branch", "OUT", "--at", "1"), ("verify", "OUT", "--against", "x"), ("top", "OUT", "--json")),
    ],
    ids=lambda command: command[0],
)
def test_a_folder_with_what_is_no_file_is_refused(command: tuple[str, ...], tmp_path: Path, capsys: Printed) -> None:
    """A named pipe, at which a reader would wait forever, a device, and a folder in a file's place; it is named."""
    for place in ("manifest.json", "runs/strange"):
        for make in (os.mkfifo, lambda path: path.symlink_to("/dev/null"), lambda path: path.mkdir()):
            out = tmp_path / f"{len([*tmp_path.iterdir()])}"
            (out / "runs").mkdir(parents=True)
            odd = out / place
            make(odd)
            if odd.suffix or not odd.is_dir():
                assert main([word.replace("OUT", str(out)) for word in command]) == 2
                assert f"{odd} must be a file" in capsys.readouterr().err


@in_one_test(
    ("command", "name"),
    [
        ("sweep smoke --out FILE", "--out"),
        ("run smoke --in-process --out FILE/run --dry-run", "--out"),
        ("study paper --freeze --out FILE", "--out"),
        ("certificates --agents 0 --out FILE/x", "--out"),
        ("certificates --operator-key FILE/key", "--operator-key"),
        ("bundle --platform linux_x86_64 --out FILE/x", "--out"),
        ("run smoke --boards 0 --boards-folder FILE --listen tcp/127.0.0.1:0 --dry-run", "--boards-folder"),
    ],
)
def test_an_output_in_whose_place_is_a_file_is_refused(
    command: str, name: str, tmp_path: Path, capsys: Printed
) -> None:
    file = tmp_path / "file"
    file.touch()
    assert main(command.replace("FILE", str(file)).split()) == 2
    assert f"{name} must be" in capsys.readouterr().err


@in_one_test(
    "options",
    [
        ("--live", "foxglove", "--live-port", "PORT"),
        ("--station", "--markers", "127.0.0.1:PORT"),
        ("--station", "--station-listen", "127.0.0.1:PORT"),
        ("--listen", "tcp/127.0.0.1:PORT"),
        ("--boards", "0", "--listen", "tcp/127.0.0.1:PORT"),
        ("--station", "--station-listen", "203.0.113.1:0"),
        ("--station", "--station-listen", "127.0.0.1:9", "--markers", "127.0.0.1:9"),
    ],
)
def test_a_taken_port_is_refused(options: tuple[str, ...], tmp_path: Path, capsys: Printed) -> None:
    """Whichever option names it, and also an address of another machine; the option is named."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        given = [option.replace("PORT", port) for option in options]
        assert main(["run", "smoke", "--dry-run", "--out", str(tmp_path / "run"), *given]) == 2
    assert f"{[option for option in options if option.startswith('--')][-1]} must be" in capsys.readouterr().err


def test_no_page_is_written_among_other_things(tmp_path: Path, capsys: Printed) -> None:
    """A new or empty folder, and one of a study or sweep, is well; another is refused, since files would be lost."""
    for folder in (tmp_path, tmp_path / "new"):
        check_out(folder, among=["provenance.csv"])
    (tmp_path / "page.md").touch()
    with pytest.raises(CommandError, match=str(tmp_path)):
        check_out(tmp_path, among=["provenance.csv"])
    assert main(["study", "lose-the-roots", "--dry-run", "--out", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err
    (tmp_path / "provenance.csv").touch()
    check_out(tmp_path, among=["provenance.csv"])
