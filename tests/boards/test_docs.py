"""The board's page, its unit and its example: what they say is so."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from contextlib import ExitStack
from pathlib import Path

import pytest

from deltaswarm_board.bodies import find_body, options_of
from deltaswarm_board.settings import read_settings
from deltaswarm_orchestrator.processes import certificates
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from tests.support.swarms import PATIENCE_S, wait_until

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "agent" / "systemd"
UNIT = FOLDER / "deltaswarm-agent@.service"
README = (ROOT / "agent" / "README.md").read_text()
PROGRAM = "/opt/deltaswarm/bin/deltaswarm-agent"
ON_A_BOARD = ("sudo ",)
"""Commands that begin so need a board, or at least root and systemd."""

Settings = dict[str, list[str]]


def unit() -> dict[str, Settings]:
    """The unit's sections: each key's values (a key may come twice, so configparser does not do)."""
    sections: dict[str, Settings] = {}
    for line in UNIT.read_text().splitlines():
        if line.startswith("["):
            section = sections.setdefault(line.strip("[]"), {})
        elif line and not line.startswith("#"):
            name, _, value = line.partition("=")
            section.setdefault(name, []).append(value)
    return sections


def commands() -> list[str]:
    blocks = re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL)
    return [line.strip() for block in blocks for line in block.splitlines()]


def test_the_unit_sets_limits_as_the_page_says() -> None:
    """Time between signs of life [s], memory [MB], share of one core."""
    service = unit()["Service"]
    [watchdog], [memory], [share] = service["WatchdogSec"], service["MemoryMax"], service["CPUQuota"]
    assert f"silent for {watchdog} s (`WatchdogSec`)" in README
    assert share == "100%"
    assert f"{memory.removesuffix('M')} MB" in README


def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("no systemd-analyze on this machine")
    instance = tmp_path / "deltaswarm-agent@3.service"
    instance.write_text(UNIT.read_text().replace(PROGRAM, "/bin/true"))
    done = subprocess.run([analyze, "verify", str(instance)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    instance.write_text(UNIT.read_text())
    missing = subprocess.run([analyze, "verify", str(instance)], capture_output=True, text=True, check=False)
    assert PROGRAM in missing.stderr or Path(PROGRAM).exists(), "it does look"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--help"], "--help is not known"), (["--venv"], "--venv FOLDER is expected"), ([], "only root may write")],
)
def test_the_installer_refuses(arguments: list[str], message: str) -> None:
    command = ["sh", str(FOLDER / "install.sh"), *arguments]
    if not arguments and os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root, and no setpriv to be somebody else with")
        command = ["setpriv", "--reuid=65534", "--clear-groups", "sh", "-s"]
    done = subprocess.run(
        command, input=(FOLDER / "install.sh").read_text(), capture_output=True, text=True, check=False, cwd="/"
    )
    assert done.returncode == 1
    assert message in done.stderr


def test_the_example_is_a_boards_file(tmp_path: Path) -> None:
    certificates.make(tmp_path, [3], [], 1)
    file = tmp_path / "3.toml"
    file.write_text((FOLDER / "example.toml").read_text().replace("/etc/deltaswarm", str(tmp_path)))
    settings = read_settings(file)
    assert settings.id == 3
    assert settings.air.tls.key_file == str(tmp_path / "agent-3.key")
    [listens] = [line for line in commands() if line.startswith("deltaswarm operator")]
    assert [endpoint.rpartition(":")[2] for endpoint in settings.air.connect] == re.findall(r":(\d+) --ca", listens)
    assert settings.log.folder == "", "the page says that what it says is in the journal"


def test_the_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert target.startswith("http") or (ROOT / "agent" / target).exists(), target


def test_the_boards_file_on_the_page_is_one(tmp_path: Path) -> None:
    """As it stands, with certificates as `deltaswarm certificates` makes them; and so with the page's vehicle."""
    vehicle, whole = re.findall(r"```toml\n(.*?)```", README, flags=re.DOTALL)
    certificates.make(tmp_path, [3], [], 1)
    file = tmp_path / "3.toml"
    file.write_text(whole.replace("/etc/deltaswarm", str(tmp_path)))
    settings = read_settings(file)
    assert (settings.id, len(settings.air.connect), settings.air.tls.verify_name) == (3, 2, False)
    file.write_text(file.read_text().replace('[body]\nkind = "kinematic"\n', vehicle))
    body = read_settings(file).body
    options = options_of(find_body(body.kind), body.options)
    assert (body.kind, options.max_speed_mps, len(options.fence_m)) == ("mavlink", 1.0, 4)


def test_the_page_names_what_a_vehicle_needs() -> None:
    extras = tomllib.loads((ROOT / "agent" / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = [requirement.partition(">")[0] for requirement in extras["mavlink"]]
    assert f"pip install {' '.join(names)}`" in README


@pytest.fixture
def place(tmp_path: Path) -> Path:
    scenario = load_scenario("smoke", ["run.start_timeout_s=240"])
    (tmp_path / "scenario.toml").write_text(to_toml(scenario))
    return tmp_path


@pytest.mark.timeout(900)
@pytest.mark.processes
@pytest.mark.slow
def test_the_commands_work(place: Path) -> None:
    """Those that need no board, in the order in which they stand; bundles of other platforms are tested elsewhere."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    python = f"{sys.version_info[0]}.{sys.version_info[1]}"
    lines = [line for line in commands() if not line.startswith(ON_A_BOARD) and not re.search("armv7l|aarch64", line)]
    assert lines
    for line in lines:
        if line.startswith("deltaswarm operator"):
            hear_nobody(re.sub(r":744\d", ":0", line), place, environment)
            continue
        if line.startswith("deltaswarm run"):
            short = re.sub(r"192.168.1.10:744\d", "127.0.0.1:0", line)
            run_with_boards(f"{short} --set run.duration_s=20 --set run.real_time_factor=10", place, environment)
            continue
        if line.startswith("deltaswarm world"):
            announced = start_world(re.sub(r":744\d", ":0", line), place, environment)
            assert [endpoint.rpartition(":")[0] for endpoint in announced] == ["tcp/127.0.0.1", "tls/0.0.0.0"]
            continue
        short = f"{line} --python {python}" if line.startswith("deltaswarm bundle") else line
        done = subprocess.run(
            short, shell=True, cwd=place, env=environment, capture_output=True, text=True, check=False
        )
        if line.startswith("deltaswarm bundle") and "No matching distribution" in done.stderr:
            pytest.skip(f"no package index: {done.stderr[-200:]}")
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"


def start_world(command: str, place: Path, environment: dict[str, str]) -> list[str]:
    with subprocess.Popen(command.split(), cwd=place, env=environment, stdout=subprocess.PIPE, text=True) as world:
        try:
            assert world.stdout is not None
            return world.stdout.readline().split()
        finally:
            world.terminate()


def run_with_boards(command: str, place: Path, environment: dict[str, str]) -> None:
    with ExitStack() as stack:
        swarm = stack.enter_context(subprocess.Popen(command.split(), cwd=place, env=environment))
        stack.callback(swarm.terminate)
        files = [place / "boards" / f"{agent}.toml" for agent in range(20, 25)]
        wait_until(lambda: files[-1].exists() or swarm.poll() is not None, "the boards' files")
        wait_until(lambda: "[agent.control]" in files[-1].read_text(), "whole files")
        parts = [swarm]
        for file in files:
            board = subprocess.Popen([sys.executable, "-P", "-m", "deltaswarm_board", str(file)])
            stack.enter_context(board)
            stack.callback(board.kill)
            parts.append(board)
        assert [part.wait(PATIENCE_S) for part in parts] == [0] * len(parts)


def hear_nobody(command: str, place: Path, environment: dict[str, str]) -> None:
    said = place / "operator.err"
    with said.open("w") as errors, subprocess.Popen(command.split(), cwd=place, env=environment, stderr=errors) as it:
        try:
            wait_until(lambda: "monitors run field" in said.read_text(), "the operator is up")
            it.terminate()
            assert it.wait(PATIENCE_S) == 0, said.read_text()
        finally:
            it.kill()
