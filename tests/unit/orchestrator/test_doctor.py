"""What a machine needs for runs and for studies, and how `deltaswarm doctor` and other commands say so."""

import importlib.metadata
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from deltaswarm_cli.main import main
from deltaswarm_wire.extras import extras, install, needed
from tests.support.complaints import Printed

MODULES = ("dask", "foxglove", "rerun", "serial")
"""Modules that their distributions do not have the names of."""


def test_doctor_tells_what_this_machine_has(capsys: Printed) -> None:
    """As JSON: each thing looked at, what was found, whether it is well, and else what to do."""
    code = main(["doctor", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert all(finding.keys() == {"name", "found", "is_well", "advice"} for finding in found)
    wanted = {"Python", "cores", "loopback", "open files", *needed(), *(f"extra {extra}" for extra in extras())}
    assert wanted <= {finding["name"] for finding in found}
    assert code == (0 if all(finding["is_well"] for finding in found) else 1)
    packages = {finding["name"]: finding["is_well"] for finding in found}
    assert all(packages[name] for name in needed()), "these tests could not run without them"


def test_doctor_looks_for_all_that_is_required(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every dependency in pyproject.toml, in the version that it asks for; each extra apart."""
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    extra = project["optional-dependencies"]["study"]
    texts = [*project["dependencies"], *(f"{text}; extra == 'study'" for text in extra)]
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: texts)
    for wanted, found in ((project["dependencies"], needed()), (extra, needed("study"))):
        assert [str(Requirement(text)) for text in wanted] == [f"{name}>={least}" for name, least in found.items()]


def test_a_lean_installation_runs_and_says_what_studies_need(tmp_path: Path) -> None:
    """Without any extra, runs, info and doctor work; whatever needs one names it in a line, before it does anything."""
    program = """
import contextlib, io, json, sys
sys.modules.update(dict.fromkeys(sys.argv[1].split(",")))
from deltaswarm_cli.main import main
from deltaswarm_studies import plan
plan.MEASURED_S = 0.0
for command in json.loads(sys.argv[2]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(command)
        except SystemExit as ended:
            code = ended.code
    print(json.dumps([code, out.getvalue(), err.getvalue()]))
"""
    (tmp_path / "runs.csv").write_text("variant,replicate,seed\n")
    run = ["run", "smoke", "--in-process", "--set", "run.duration_s=5", "--set", "agents.count=150", "--out", "a"]
    plan = ["study", "lose-the-roots", "--plan"]
    well = [run, ["info", "a"], ["doctor"], ["list"], ["study", "paper", "--render", "--help"], plan]
    well += [["sweep", "modes", "--dry-run"], [*plan, "--pilot", "."]]
    again = [*run[:-1], "b", "--set", "radio.range_m=200"]
    refusals = {
        ("scipy", "study"): ([*again, "--set", "control.mode=central"], [*again, "--set", "run.bound=density"]),
        ("matplotlib", "study"): (["value", "a"], ["branch", "a", "--at", "2", "--replicates", "8"]),
        ("pandas", "study"): (["sweep", "smoke"], ["report", "a"]),
        ("jsbsim", "jsbsim"): ([*again, "--set", "world.dynamics=jsbsim"],),
        ("pymunk", "physics"): ([*again, "--set", "world.dynamics=physics"],),
        ("pycdr2", "ros2"): ([*again, "--live", "ros2"],),
        ("foxglove-sdk", "live"): ([*again, "--live", "foxglove"],),
        ("distributed", "cluster"): (["sweep", "smoke", "--engine", "dask"],),
        ("matplotlib", "export"): (["export", "a", "--format", "mp4"],),
        ("rosbags", "export"): (["export", "a", "--format", "rosbag2"],),
        ("rerun-sdk", "export"): (["export", "a", "--format", "rrd"],),
    }
    commands = [*well, *(command for each in refusals.values() for command in each)]
    hidden = ",".join({module for extra in extras() for module in (*needed(extra), *MODULES)})
    command = [sys.executable, "-c", program, hidden, json.dumps(commands)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert [each[0] for each in told[: len(well)]] == [0] * len(well), told
    assert told[len(well) - 1][1].splitlines()[-1].endswith(install("study"))
    wanted = [f"needs {name}: {install(extra)}" for (name, extra), each in refusals.items() for _ in each]
    for (code, _, complaint), needs in zip(told[len(well) :], wanted, strict=True):
        assert (code, complaint.count("\n"), needs in complaint) == (2, 1, True), complaint
    assert not (tmp_path / "b").exists()


def test_doctor_says_what_to_do_where_something_is_missing(monkeypatch: pytest.MonkeyPatch, capsys: Printed) -> None:
    """With the command that gets it, and exit code 1."""
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: ["no-such-package>=3.1", "msgpack>=999.0"])
    assert main(["doctor"]) == 1
    lines = {line.split()[1]: line for line in capsys.readouterr().out.splitlines()}
    assert lines["no-such-package"].startswith("MISSING")
    assert lines["no-such-package"].endswith("'no-such-package>=3.1'")
    assert lines["msgpack"].startswith("MISSING")
    assert lines["Python"].startswith("ok")
