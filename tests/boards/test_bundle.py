"""The bundle for boards without internet: what is in it, that it installs, and that the agent runs from it."""

import hashlib
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from email.parser import Parser
from importlib.metadata import distributions, version
from pathlib import Path
from threading import Lock
from typing import Any

import pytest
from packaging.utils import parse_wheel_filename

from deltaswarm_cli.main import main
from deltaswarm_field import bundle as bundles
from deltaswarm_field.bundle import PACKAGES, PLATFORMS, PYTHONS, BundleError
from deltaswarm_wire import __version__
from tests.support.boards import run_with_board, usual_digest
from tests.support.complaints import names

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # a dozen calls of pip, each of which may wait for its index

ROOT = Path(__file__).parents[2]
ARM64, ARM32, PC = PLATFORMS
BESIDE_WHEELS = {"README.md", "SHA256SUMS", "deltaswarm-agent@.service", "example.toml", "install.sh", "wheels"}
NEWER = (11, 12, 13, 14, 15)
BUNDLED = sorted({PYTHONS[0], f"3.{sys.version_info[1]}", PYTHONS[-1]})
"""Of the Pythons of a bundle, the oldest, this one and the newest; pip takes a second for each on each platform."""


def building_once(built: Path) -> Callable[..., None]:
    """A stand-in for pip that builds the agent's wheel, which is the same in all bundles, once and copies it."""
    lock, pip = Lock(), bundles.run_pip

    def run(command: str, *arguments: str, **options: Any) -> None:
        if command != "wheel" or options:
            pip(command, *arguments, **options)
            return
        place = arguments.index("--wheel-dir") + 1
        with lock:
            if not built.exists():
                pip(command, *arguments[:place], str(built), *arguments[place + 1 :])
        shutil.copytree(built, arguments[place], dirs_exist_ok=True)

    return run


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bundles")
    reach = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--no-cache-dir", "--dest", str(folder / "x")]
    done = subprocess.run([*reach, f"msgpack=={version('msgpack')}"], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"no package index: {done.stderr[-200:]}")
    with ThreadPoolExecutor() as pool, pytest.MonkeyPatch.context() as patch:
        patch.setattr(bundles, "run_pip", building_once(folder / "built"))
        pythons = [word for python in BUNDLED for word in ("--python", python)]
        commands = [["bundle", "--platform", one, "--out", str(folder / one), *pythons] for one in PLATFORMS]
        assert list(pool.map(main, commands)) == [0] * len(PLATFORMS)
    return folder


def wheels(folder: Path) -> list[Path]:
    return sorted((folder / "wheels").iterdir())


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_bundle_holds_three_projects_and_what_installs_them(made: Path, platform: str) -> None:
    """In this machine's versions; each wheel's tag fits the platform, and there is one for every Python."""
    assert {path.name for path in (made / platform).iterdir()} == BESIDE_WHEELS
    found = wheels(made / platform)
    parsed = [parse_wheel_filename(wheel.name) for wheel in found]
    wanted = {
        "deltaswarm-agent": __version__,
        **{name: version(name) for name in ("eclipse-zenoh", "msgpack", "pycdr2")},
    }
    assert {name: str(number) for name, number, _, _ in parsed} == wanted
    machine = platform.removeprefix("linux_")
    for _, _, _, tags in parsed:
        assert {tag.platform == "any" or tag.platform.endswith(f"_{machine}") for tag in tags} == {True}
    for name in wanted:
        tags = [{tag.interpreter for tag in own} for project, _, _, own in parsed if project == name]
        for python in BUNDLED:
            exact = f"cp{python.replace('.', '')}"
            assert any(exact in own or own & {"py3", "cp39"} for own in tags), (name, python)
    assert not list(made.glob(".*")), "nothing half-written is left"


def test_the_32_bit_boards_msgpack_is_pure_python(made: Path) -> None:
    [pure] = (made / ARM32 / "wheels").glob("msgpack-*")
    assert pure.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(pure) as archive:
        assert {Path(name).suffix for name in archive.namelist() if name.startswith("msgpack/")} == {".py"}
    for platform in (ARM64, PC):
        assert len(list((made / platform / "wheels").glob("msgpack-*"))) == len(BUNDLED)


def test_the_agents_wheel_holds_the_agent_and_its_vocabulary(made: Path) -> None:
    [agent] = (made / ARM32 / "wheels").glob("deltaswarm_agent-*")
    with zipfile.ZipFile(agent) as archive:
        folders = {name.split("/")[0] for name in archive.namelist()}
        metadata = Parser().parsestr(archive.read(f"deltaswarm_agent-{__version__}.dist-info/METADATA").decode())
    assert folders == {*PACKAGES, f"deltaswarm_agent-{__version__}.dist-info"}
    needed = [text for text in metadata.get_all("Requires-Dist", []) if "extra ==" not in text]
    assert {text.split(">")[0] for text in needed} == {"eclipse-zenoh", "msgpack"}


@pytest.mark.parametrize("platform", PLATFORMS)
def test_the_sums_are_those_of_all_files(made: Path, platform: str) -> None:
    lines = (made / platform / "SHA256SUMS").read_text().splitlines()
    sums = {name: number for number, name in (line.split("  ", 1) for line in lines)}
    files = [path for path in (made / platform).rglob("*") if path.is_file() and path.name != "SHA256SUMS"]
    assert sums == {
        str(path.relative_to(made / platform)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files
    }


@pytest.mark.usefixtures("made")
def test_an_installed_deltaswarm_has_all_that_a_bundle_is_made_of(tmp_path: Path) -> None:
    """Without its source tree: the same files come out of it as out of the tree."""
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(tmp_path), str(ROOT)]
    subprocess.run(command, check=True)
    [wheel] = tmp_path.glob("deltaswarm-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    code = "from pathlib import Path\nfrom deltaswarm_field import bundle\nbundle.copy_source(Path('found'))"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "installed")}
    subprocess.run([sys.executable, "-P", "-c", code], cwd=tmp_path, env=environment, check=True)
    bundles.copy_source(tmp_path / "wanted")
    found, wanted = (
        {path.relative_to(top): path.read_bytes() for path in top.rglob("*") if path.is_file()}
        for top in (tmp_path / "found", tmp_path / "wanted")
    )
    assert found == wanted
    assert Path("systemd/install.sh") in found


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bundle", "--platform", ARM64, "--out", str(tmp_path)]) == 2
    assert names(capsys.readouterr().err, f"--out: {tmp_path}")


def test_without_an_index_pips_own_words_are_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    assert main(["bundle", "--platform", ARM64, "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert "pip wheel" in said
    assert "hatchling" in said
    assert list(tmp_path.iterdir()) == []


def test_a_wheel_that_does_not_fit_stops_the_bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def bring(command: str, *arguments: str, environment: object = None) -> None:
        folder = arguments[arguments.index("--wheel-dir" if command == "wheel" else "--dest") + 1]
        Path(folder, "msgpack-1.0-cp311-cp311-linux_x86_64.whl").touch()

    monkeypatch.setattr(bundles, "run_pip", bring)
    with pytest.raises(BundleError, match="msgpack"):
        bundles.bundle(tmp_path / "out", ARM64)
    assert list(tmp_path.iterdir()) == []


def install(bundle: Path, target: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": ""}
    command = ["sh", str(bundle / "install.sh"), "--venv", str(target)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def installed(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    environment = tmp_path_factory.mktemp("installed") / "board"
    done = install(made / PC, environment)
    assert done.returncode == 0, done.stderr
    return environment


def names_of(environment: Path) -> set[str]:
    [packages] = (environment / "lib").glob("python3*/site-packages")
    return {str(one.name).lower() for one in distributions(path=[str(packages)])} - {"pip", "setuptools"}


def test_the_bundle_installs_offline_into_an_empty_environment(installed: Path, tmp_path: Path) -> None:
    assert names_of(installed) == {"deltaswarm-agent", "eclipse-zenoh", "msgpack", "pycdr2"}
    python, script = str(installed / "bin" / "python"), str(installed / "bin" / "deltaswarm-agent")
    for command, shown in (
        ([python, "-m", "deltaswarm_agent"], "deltaswarm agent"),
        ([python, "-m", "deltaswarm_board"], "deltaswarm agent board"),
        ([script], "deltaswarm-agent"),
        ([script, "board"], "deltaswarm-agent board"),
    ):
        told = subprocess.run([*command, "--help"], cwd=tmp_path, capture_output=True, text=True, check=True)
        assert f"usage: {shown} [-h]" in told.stdout


def test_a_bundle_for_boards_that_obey_an_operator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example has its public key, and what checks signatures is fetched for each Python; a wrong key is refused."""
    fetched: list[str] = []
    monkeypatch.setattr(bundles, "_build", lambda *arguments, **options: None)
    monkeypatch.setattr(bundles, "_fetch", lambda wanted, platform, python, wheels: fetched.append(wanted))
    key = "0123456789abcdef" * 4
    command = ["bundle", "--platform", ARM64, "--out", str(tmp_path / "out"), "--python", "3.11", "--python", "3.13"]
    with pytest.raises(SystemExit, match="2"):
        main([*command, "--operator-key", key[1:]])
    assert main([*command, "--operator-key", key]) == 0
    example = tomllib.loads((tmp_path / "out" / "example.toml").read_text())
    assert example["air"]["operator_key"] == key
    names = [wanted.partition("==")[0] for wanted in fetched]
    assert {name: names.count(name) for name in ("cryptography", "cffi", "pycparser")} == {
        "cryptography": 1,
        "cffi": 2,
        "pycparser": 1,
    }


def test_a_damaged_bundle_is_not_installed(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made / PC, tmp_path / "bundle")
    with wheels(tmp_path / "bundle")[0].open("ab") as wheel:
        wheel.write(b"x")
    done = install(tmp_path / "bundle", tmp_path / "board")
    assert done.returncode == 1
    assert "damaged" in done.stderr
    assert not (tmp_path / "board").exists()


def test_what_the_list_does_not_name_is_not_installed(made: Path, tmp_path: Path) -> None:
    bundle = shutil.copytree(made / PC, tmp_path / "bundle")
    (bundle / "wheels" / "msgpack-99.0-py3-none-any.whl").write_bytes(b"")
    done = install(bundle, tmp_path / "board")
    assert done.returncode == 1
    assert "msgpack-99.0-py3-none-any.whl is not listed in SHA256SUMS" in done.stderr
    (bundle / "SHA256SUMS").unlink()
    done = install(bundle, tmp_path / "board")
    assert done.returncode == 1
    assert "SHA256SUMS is missing" in done.stderr
    assert not (tmp_path / "board").exists()


def test_settings_of_whoever_installs_change_nothing(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Others can read what root installs, and it is where it is said to be."""
    for name, value in (("PIP_TARGET", "elsewhere"), ("PIP_NO_DEPS", "1"), ("PYTHONPATH", "elsewhere")):
        monkeypatch.setenv(name, str(tmp_path / value) if value == "elsewhere" else value)
    before = os.umask(0o077)
    try:
        done = install(made / PC, tmp_path / "board")
    finally:
        os.umask(before)
    assert done.returncode == 0, done.stderr
    assert names_of(tmp_path / "board") == {"deltaswarm-agent", "eclipse-zenoh", "msgpack", "pycdr2"}
    files = [path for path in (tmp_path / "board").rglob("*") if not path.is_symlink()]
    assert all(path.stat().st_mode & 0o044 == 0o044 for path in files)


def test_another_machines_bundle_is_not_installed(made: Path, installed: Path) -> None:
    before = names_of(installed)
    other = ARM64 if os.uname().machine == "x86_64" else PC
    done = install(made / other, installed)
    assert done.returncode == 1
    assert "no wheels" in done.stderr
    assert names_of(installed) == before


def found_python(minor: int) -> str:
    command = [f"python3.{minor}", "-c", "import sys; print(sys.executable)"]
    environment = {**os.environ, "PYENV_VERSION": f"3.{minor}"}
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def environment_of(python: str, folder: Path, packages: Sequence[Path]) -> Path:
    made = folder / "bin" / "python"
    subprocess.run([python, "-m", "venv", "--without-pip", str(folder)], check=True)
    pip = [sys.executable, "-m", "pip", "--python", str(made)]
    subprocess.run([*pip, "install", "-q", "--no-index", *map(str, packages)], check=True)
    return made


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> str:
    return usual_digest(tmp_path_factory.mktemp("usual"))


@pytest.mark.processes
@pytest.mark.parametrize("minor", NEWER)
def test_the_agent_runs_with_the_32_bit_boards_wheels(made: Path, usual: str, tmp_path: Path, minor: int) -> None:
    """Agent and pure-Python msgpack as bundled for armv7l, over TLS, in a whole run; the digest is the usual one."""
    python = sys.executable if sys.version_info[1] == minor else found_python(minor)
    if not python or os.uname().machine != "x86_64":
        pytest.skip(f"no Python 3.{minor} on an x86_64 machine")
    pure = [wheel for wheel in wheels(made / ARM32) if wheel.name.startswith(("deltaswarm_agent-", "msgpack-"))]
    assert [wheel.name.endswith("-py3-none-any.whl") for wheel in pure] == [True, True]
    zenoh = (made / PC / "wheels").glob("eclipse_zenoh-*")
    board = environment_of(python, tmp_path / "board", [*pure, *zenoh])
    used = [str(board), "-c", "import msgpack; print(msgpack.Packer.__module__)"]
    assert subprocess.run(used, capture_output=True, text=True, check=True).stdout.strip() == "msgpack.fallback"
    outcome = run_with_board(tmp_path, [str(board), "-P", "-m", "deltaswarm_agent"], {})
    assert outcome.digest == usual
