"""Completion by the shell: the scripts are valid, and the one for bash offers what there is."""

import shutil
import subprocess
from pathlib import Path

import pytest

from deltaswarm_cli.installation import SHELLS
from deltaswarm_cli.main import main


def script(shell: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["completion", shell]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_accepts_its_script(shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As far as the shell is installed; every script names the options."""
    file = tmp_path / "script"
    file.write_text(script(shell, capsys))
    assert "station-listen" in file.read_text()
    if shutil.which(shell):
        done = subprocess.run([shell, "-n", file], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("typed", "offered"), [("deltaswarm stu", "study"), ("deltaswarm run --station-l", "--station-listen")]
)
def test_bash_completes(typed: str, offered: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Commands, their options, and subcommands."""
    words = typed.split()
    quoted = " ".join(f"'{word}'" for word in words)
    file = tmp_path / "complete.sh"
    ask = f"COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; COMP_LINE='{typed}'; COMP_POINT=${{#COMP_LINE}}"
    last = f"f=$(complete -p deltaswarm | sed 's/.*-F \\([^ ]*\\).*/\\1/'); $f deltaswarm '{words[-1]}'"
    file.write_text(f"{script('bash', capsys)}\n{ask}\n{last}\nprintf '%s\\n' \"${{COMPREPLY[@]}}\"\n")
    done = subprocess.run(["bash", file], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [offered], done.stderr
