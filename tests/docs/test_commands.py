"""Every command that the documentation names exists; every block of commands runs in a test."""

import json
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from docs.extensions.command_line import subparsers
from docs.extensions.scenario_keys import reference

from deltaswarm_board.__main__ import parser as board_parser
from deltaswarm_cli.main import all_commands, parser
from deltaswarm_orchestrator.live.views import LIVE_SOCKET
from tests.support.pages import ROOT, commands, files, shell
from tests.support.swarms import COMMAND, UNHURRIED, wait_until
from tests.support.tiers import in_one_test

RUN_ELSEWHERE = {
    "docs/BY_LINK.md": "processes/test_by_link",
    "docs/LEARNING.md": "docs/test_learning",
    "docs/TESTING.md": "docs/test_testing",
    "README.md": "docs/test_readme",
    "agent/README.md": "boards/test_docs",
    "docs/CONTROLLERS.md": "docs/test_controllers",
    "docs/ROS2.md": "docs/test_ros2",
    "docs/SCALE.md": "docs/test_scale",
    "docs/SESSION.md": "docs/test_session",
    "docs/STATION.md": "docs/test_station",
    "docs/STUDIES.md": "docs/test_studies",
    "docs/SWEEPS.md": "docs/test_readme",
    "docs/TUTORIAL.md": "docs/test_tutorial",
}
"""The test that runs all commands of a page, except those that need another machine or ROS."""
RUN_HERE = {"CONTRIBUTING.md", "docs/EXTENDING.md", "docs/FAILURES.md", "docs/LIVE.md", "docs/RECORDING.md"}

PAGES = {
    str(path.relative_to(ROOT)): path.read_text()
    for folder in ("*.md", "docs/*.md", "docs/api/*.md", "agent/**/*.md")
    for path in ROOT.glob(folder)
}


def page(name: str) -> str:
    return PAGES[name]


def known_options(command: str) -> set[str]:
    if command == "agent board":
        return set(board_parser()._option_string_actions)
    found = parser(command.split()[0])
    for word in command.split():
        found = subparsers(found)[word]
    return set(found._option_string_actions)


def test_every_block_of_commands_runs_in_a_test() -> None:
    """Of each page either in its own test or in this file."""
    with_commands = {name for name, text in PAGES.items() if commands(text)}
    assert with_commands == {*RUN_ELSEWHERE, *RUN_HERE}
    for test in RUN_ELSEWHERE.values():
        assert (ROOT / "tests" / f"{test}.py").exists()


@in_one_test("name", sorted(PAGES))
def test_every_command_in_the_text_exists(name: str) -> None:
    """With its options; values are placeholders as often as not."""
    for span in re.findall(r"`(deltaswarm [^`]+)`", page(name)):
        words = shlex.split(span)[1:]
        command = " ".join(words[:2]) if words[:2] == ["agent", "board"] else words[0]
        if words[0] in all_commands() or command == "agent board":
            options = {word.partition("=")[0] for word in words if word.startswith("-")} - {"--help"}
            assert options <= known_options(command), span
        else:
            assert command in ("agent", "world", "operator", "..."), span


@in_one_test("name", sorted(PAGES))
def test_the_files_on_a_page_are_toml_with_a_name(name: str) -> None:
    """A reader who saves one knows what to call it."""
    assert all(re.fullmatch(r"[\w-]+\.toml", file) for file in files(page(name)))


@pytest.mark.processes
@pytest.mark.slow
def test_a_run_that_was_killed_goes_on(tmp_path: Path) -> None:
    """The commands of FAILURES.md, with a shorter run: cut off after a checkpoint, resumed, and whole."""
    begin, resume = commands(page("docs/FAILURES.md"))
    newest = tmp_path / "runs" / "long.part" / "checkpoint" / "newest.json"
    short = begin.replace("paper-25", "smoke").replace("--checkpoint 500", "--checkpoint 100")
    arguments = shlex.split(short.removeprefix("deltaswarm "))
    run = subprocess.Popen([*COMMAND, *arguments], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_until(lambda: newest.exists() or run.poll() is not None, "a checkpoint")
    finally:
        run.kill()
        run.wait()
    done = shell(resume, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(json.loads((tmp_path / "runs" / "long" / "manifest.json").read_text())["resumed"]) == 1


def test_the_commands_for_pages_made_from_the_code_write_them(tmp_path: Path) -> None:
    for name in ("RESULTS.md", "STATION.md"):
        shutil.copy(ROOT / "docs" / name, tmp_path)
    for command in commands(page("docs/EXTENDING.md")):
        if not command.startswith("python docs/"):
            continue
        done = shell(re.sub(r"docs/(\w+\.md)", rf"{tmp_path}/\1", command), ROOT)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "SCENARIO.md").read_text() == reference()
    for name in ("RESULTS.md", "STATION.md"):
        assert (tmp_path / name).read_text() == page(f"docs/{name}")


def test_the_examples_of_extensions_work(tmp_path: Path) -> None:
    """Those of EXTENDING.md, saved under their names, in valid runs; fog takes frames."""
    text = page("docs/EXTENDING.md")
    modules = dict(re.findall(r"```python\n# (\w+\.py)\n(.*?)```", text, re.DOTALL))
    assert set(modules) == {"fog.py", "wind.py", "sluggish.py", "patient.py"}
    for name, code in (modules | files(text)).items():
        (tmp_path / name).write_text(code)
    done = shell("\n".join(line for line in commands(text) if not line.startswith("python docs/")), tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    runs = {run.name: json.loads((run / "summary.json").read_text()) for run in (tmp_path / "runs").iterdir()}
    assert {name: summary["valid"] for name, summary in runs.items()} == dict.fromkeys(
        ("fog", "windy", "sluggish"), True
    )
    assert runs["fog"]["frames_dropped"]["fog"] > 0


@pytest.mark.slow
def test_a_recording_is_exported(tmp_path: Path) -> None:
    """The command of RECORDING.md, beside the run that it exports."""
    [command] = commands(page("docs/RECORDING.md"))
    run = "deltaswarm run smoke --in-process --set run.duration_s=20 --out runs/first"
    done = shell(f"{run} && {command}", tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.processes
@pytest.mark.slow
def test_a_run_is_watched(tmp_path: Path) -> None:
    """The commands of LIVE.md, with a smaller run on any port; `top` prints what it would draw."""
    look, begin = commands(page("docs/LIVE.md"))
    small = begin.replace("paper-25", "smoke") + " --live-port 0"
    arguments = [*shlex.split(small.removeprefix("deltaswarm ")), *UNHURRIED]
    run = subprocess.Popen(
        [*COMMAND, *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    try:
        there = tmp_path / "runs" / "first.part" / LIVE_SOCKET
        wait_until(lambda: there.exists() or run.poll() is not None, "a run to look at")
        looked = shell(f"{look} --json", tmp_path)
        assert looked.returncode == 0, looked.stdout + looked.stderr
        assert json.loads(looked.stdout)["hello"]["run"] == "first"
        _, errors = run.communicate()
    finally:
        run.kill()
        run.wait()
    assert run.returncode == 0, errors
    assert b"ws://127.0.0.1:" in errors


def test_the_commands_for_contributors_exist() -> None:
    """They are those of the gate (its test is test_docs_readme), of lint (test_quality) and of the site."""
    for line in commands(page("CONTRIBUTING.md")):
        for path in re.findall(r"tests/\S+\.py", line):
            assert (ROOT / path).exists(), path
