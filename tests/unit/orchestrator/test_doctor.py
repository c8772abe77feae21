"""What a machine needs for runs and for studies, and how `deltaswarm doctor` and other commands say so."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from deltaswarm_orchestrator import doctor
from deltaswarm_orchestrator.cli import main
from tests.support.complaints import Printed


def test_doctor_tells_what_this_machine_has(capsys: Printed) -> None:
    """As JSON: each thing looked at, what was found, whether it is well, and else what to do."""
    code = main(["doctor", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert all(finding.keys() == {"name", "found", "is_well", "advice"} for finding in found)
    assert {"Python", "cores", "loopback", "open files", *doctor.needed()} <= {finding["name"] for finding in found}
    assert code == (0 if all(finding["is_well"] for finding in found) else 1)
    packages = {finding["name"]: finding["is_well"] for finding in found}
    assert all(packages[name] for name in doctor.needed()), "these tests could not run without them"


def test_doctor_looks_for_all_that_is_required(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every dependency in pyproject.toml, in the version that it asks for; each extra apart."""
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    extra = project["optional-dependencies"]["study"]
    texts = [*project["dependencies"], *(f"{text}; extra == 'study'" for text in extra)]
    monkeypatch.setattr(doctor, "requires", lambda _: texts)
    for wanted, found in ((project["dependencies"], doctor.needed()), (extra, doctor.needed("study"))):
        assert [str(Requirement(text)) for text in wanted] == [f"{name}>={least}" for name, least in found.items()]


def test_a_lean_installation_runs_and_says_what_studies_need(tmp_path: Path) -> None:
    """Without the extra `study`: runs, info and doctor work; a study names the package and how to get it."""
    program = """
import contextlib, io, json, sys
sys.modules.update(dict.fromkeys(sys.argv[1].split(",")))
from deltaswarm_orchestrator.cli import main
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
    commands = [run, ["info", "a"], ["doctor"], ["list"], ["study", "paper", "--render", "--help"], plan]
    commands += [["sweep", "modes", "--dry-run"], [*plan, "--pilot", "."], ["sweep", "smoke"]]
    hidden = ",".join(doctor.needed("study"))
    command = [sys.executable, "-c", program, hidden, json.dumps(commands)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    *well, (code, planned, complaint), refused = map(json.loads, done.stdout.splitlines())
    assert [each[0] for each in well] == [0] * 7, well
    assert (code, complaint) == (0, "")
    assert planned.splitlines()[-1].endswith(doctor.INSTALL_STUDY)
    assert refused[0] == 2
    assert doctor.INSTALL_STUDY in refused[2]


def test_doctor_says_what_to_do_where_something_is_missing(monkeypatch: pytest.MonkeyPatch, capsys: Printed) -> None:
    """With the command that gets it, and exit code 1."""
    monkeypatch.setattr(doctor, "requires", lambda _: ["no-such-package>=3.1", "msgpack>=999.0"])
    assert main(["doctor"]) == 1
    lines = {line.split()[1]: line for line in capsys.readouterr().out.splitlines()}
    assert lines["no-such-package"].startswith("MISSING")
    assert lines["no-such-package"].endswith("'no-such-package>=3.1'")
    assert lines["msgpack"].startswith("MISSING")
    assert lines["Python"].startswith("ok")
