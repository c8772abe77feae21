"""Compiled cores: a wheel that has them makes the same runs as pure Python, in processes and in one."""

import json
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path
from typing import Any

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.processes,
    pytest.mark.skipif(not (shutil.which("gcc") or shutil.which("cc")), reason="there is no C compiler here"),
]

ROOT = Path(__file__).parents[2]

RESUMED = """\
import pickle
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario

swarm = InProcess(load_scenario("smoke", ["record=off", "events.rate_hz=0.5", "control.mode=adaptive"], 3))
for step in range(200):
    if step == 100:
        swarm.world, swarm.agents = pickle.loads(pickle.dumps((swarm.world, swarm.agents)))
    swarm.step(step, last=False)
print(swarm.world.digest.hex())
"""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an unpacked wheel with compiled cores."""
    folder = tmp_path_factory.mktemp("compiled")
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder / "dist"), str(ROOT)]
    subprocess.run(command, check=True, env={**os.environ, "DELTASWARM_COMPILE": "1"})
    (wheel,) = (folder / "dist").glob("*.whl")
    assert "none-any" not in wheel.name
    zipfile.ZipFile(wheel).extractall(folder / "site")
    return folder / "site"


def python(site: Path | None, *arguments: str) -> str:
    """The output of Python with this package before the one under test, or with the one under test."""
    environment = {**os.environ, "PYTHONPATH": str(site)} if site else None
    done = subprocess.run(
        [sys.executable, "-P", *arguments], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def run(site: Path | None, out: Path, *arguments: str) -> dict[str, Any]:
    options = ("--record", "off", "--json", "--out", str(out), *arguments)
    summary = json.loads(python(site, "-m", "deltaswarm_orchestrator", "run", "smoke", *options))
    return {**summary, **json.loads((out / "manifest.json").read_text())}


@pytest.mark.parametrize("mode", ["decentralised", "hierarchical", "hybrid", "adaptive"])
def test_the_digest_is_that_of_pure_python(compiled: Path, tmp_path: Path, mode: str) -> None:
    sets = ("--in-process", "--set", f"control.mode={mode}", "--set", "run.step_s=0.5")
    pure, native = run(None, tmp_path / "pure", *sets), run(compiled, tmp_path / "native", *sets)
    assert (pure["build"], native["build"]) == ("pure Python", "compiled")
    assert native["digest"] == pure["digest"]
    assert native["code"] == pure["code"]


def test_processes_with_checkpoints_make_the_same_digest(compiled: Path, tmp_path: Path) -> None:
    inside = run(None, tmp_path / "inside", "--in-process")
    outside = run(compiled, tmp_path / "outside", "--checkpoint", "50")
    assert outside["valid"], outside["invalid_because"]
    assert outside["digest"] == inside["digest"]


def test_what_was_pickled_goes_on_as_it_was(compiled: Path) -> None:
    assert python(compiled, "-c", RESUMED) == python(None, "-c", RESUMED)


def test_third_parties_decisions_and_samples_are_checked_alike(compiled: Path) -> None:
    """What compiled code expects of types must not take the place of the checks, nor of what they allow."""
    tests = ("tests/unit/agent/test_core.py", "tests/unit/wire/test_codec.py")
    python(
        compiled,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "--rootdir",
        str(ROOT),
        *(str(ROOT / t) for t in tests),
    )


def test_an_installation_is_compiled_and_pure_again(tmp_path: Path) -> None:
    """In an environment of its own, whose other packages are those of this one."""
    venv.create(tmp_path, with_pip=False)
    site = next(tmp_path.glob("lib/python*/site-packages"))
    (site / "others.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    pip = [sys.executable, "-m", "pip", "--python", str(tmp_path / "bin" / "python")]
    subprocess.run([*pip, "install", "-q", "--no-deps", "--ignore-installed", str(ROOT)], check=True)

    def command(*arguments: str) -> str:
        done = subprocess.run(
            [tmp_path / "bin" / "deltaswarm", *arguments], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def build() -> str:
        return str({row["name"]: row["found"] for row in json.loads(command("doctor", "--json"))}["build"])

    assert build() == "pure Python"
    assert command("compile").startswith("compiled ")
    assert build() == "compiled"
    command("compile", "--remove")
    assert build() == "pure Python"
    assert not list(site.rglob("deltaswarm*/**/*.so"))


def test_the_doctor_says_what_is_installed(compiled: Path) -> None:
    found = json.loads(python(compiled, "-m", "deltaswarm_orchestrator", "doctor", "--json"))
    assert {row["name"]: row["found"] for row in found}["build"] == "compiled"
