"""Names on the command line: what there is, what was probably meant, and what each key means."""

import json
import tomllib
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from tests.support.complaints import Printed


def code_of(command: str) -> int:
    """The exit code of a command line, which its parser may refuse."""
    try:
        return main(command.split())
    except SystemExit as ended:
        return int(ended.code or 0)


def test_the_list_names_what_the_commands_take(capsys: Printed) -> None:
    """Every scenario, sweep and study can be loaded by its name, every controller found."""
    assert main(["list", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found) == [
        "scenarios",
        "sweeps",
        "studies",
        "controllers",
        "commands",
        "bodies",
        "dynamics",
        "radio models",
        "faults",
    ]
    assert all(text for names in found.values() for text in names.values())
    assert all(text.endswith(".") for kind in ("scenarios", "sweeps", "studies") for text in found[kind].values())
    for name in found["scenarios"]:
        assert main(["run", name, "--dry-run"]) == 0
    for name in (*found["sweeps"], *found["studies"]):
        assert main(["sweep", name, "--dry-run"]) == 0
    far = ("--set", "radio.range_m=150")  # central control needs it
    for mode in found["controllers"]:
        assert main(["run", "smoke", "--dry-run", "--set", f"control.mode={mode}", *far]) == 0
    assert main(["list"]) == 0
    assert "kinematic" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("command", "meant"),
    [
        ("rnu smoke", "run"),
        ("run somke", "smoke"),
        ("sweep mode", "modes"),
        ("study limts", "limits"),
        ("run smoke --sed 3", "--seed"),
        ("run --dry-rn=yes", "--dry-run"),
        ("why runs/a --jsn", "--json"),
        ("world --expekt operator", "--expect"),
        ("agent board --chek", "--check"),
    ],
)
def test_a_slip_of_the_pen_is_understood(command: str, meant: str, capsys: Printed) -> None:
    """Commands, options, scenarios and the rest: the name that was probably meant is offered, with exit code 2."""
    assert code_of(command) == 2
    assert f"did you mean {meant!r}?" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        *("run nosuch", "run --resume nosuch", "run smoke --commands nosuch", "sweep nosuch", "study nosuch"),
        *("session nosuch --participant 1", "report nosuch", "info nosuch", "why nosuch 1 2 --at 3", "replay nosuch"),
        *("export nosuch --format csv", "station nosuch", "top nosuch --json"),
    ],
)
def test_a_name_that_does_not_exist_is_said_with_where_it_was_looked_for(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """One line with the full path; exit code 2, and nothing is made."""
    monkeypatch.chdir(tmp_path)
    assert main(command.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / "nosuch") in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["info", "replay", "export --format csv"])
def test_the_folder_that_was_probably_meant_is_offered(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """A neighbour with a similar name, or what is left of an interrupted run."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lossy-1").mkdir()
    (tmp_path / "clear.part").mkdir()
    for given, meant in (("losy-1", "lossy-1"), ("clear", "clear.part")):
        assert main([*command.split(), given]) == 2
        assert meant in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run smoke --dry", "run --re runs/a", "operator --thresh 1", "agent --i 3"])
def test_options_are_not_abbreviated(command: str, capsys: Printed) -> None:
    """An option to come may begin alike; what was given is named."""
    assert code_of(command) == 2
    assert repr(next(word for word in command.split() if word.startswith("--"))) in capsys.readouterr().err


def test_what_looks_like_an_option_may_be_a_value_or_follow_help(capsys: Printed) -> None:
    """After `--` there are no options, and help is shown whatever else is wrong."""
    assert code_of("run --dry-run -- --no-such-scenario") == 2
    assert "scenario" in capsys.readouterr().err
    assert code_of("run --help --no-such") == 0


def test_a_dry_run_explains_every_key_in_toml(capsys: Printed) -> None:
    """The comments do not change what it says; keys with a unit in their name have it in their meaning."""
    assert main(["run", "smoke", "--dry-run"]) == 0
    printed = capsys.readouterr().out
    assert load(Scenario, tomllib.loads(printed)) == load_scenario("smoke")
    for line in printed.splitlines():
        name, _, comment = line.partition("#")
        if name.split(" = ")[0].endswith(("_s", "_hz")):
            assert comment, line
