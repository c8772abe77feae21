"""Names on the command line: what there is, what was probably meant, and what each key means."""

import json
import tomllib

import pytest

from deltaswarm_orchestrator.cli import main
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load

Printed = pytest.CaptureFixture[str]


def test_the_list_names_what_the_commands_take(capsys: Printed) -> None:
    """Every scenario, sweep and study can be loaded by its name, every controller found."""
    assert main(["list", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found) == ["scenarios", "sweeps", "studies", "controllers", "commands", "bodies"]
    assert all(text for names in found.values() for text in names.values())
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
    [("rnu smoke", "run"), ("run somke", "smoke"), ("sweep mode", "modes"), ("study limts", "limits")],
)
def test_a_slip_of_the_pen_is_understood(command: str, meant: str, capsys: Printed) -> None:
    """Commands, scenarios, sweeps and studies: the name that was probably meant is offered, with exit code 2."""
    assert main(command.split()) == 2
    assert f"did you mean {meant!r}?" in capsys.readouterr().err


def test_a_dry_run_explains_every_key_in_toml(capsys: Printed) -> None:
    """The comments do not change what it says; keys with a unit in their name have it in their meaning."""
    assert main(["run", "smoke", "--dry-run"]) == 0
    printed = capsys.readouterr().out
    assert load(Scenario, tomllib.loads(printed)) == load_scenario("smoke")
    for line in printed.splitlines():
        name, _, comment = line.partition("#")
        if name.split(" = ")[0].endswith(("_s", "_hz")):
            assert comment, line
