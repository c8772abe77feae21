"""What the documentation says to do: its pages, their commands, and the files that they ask a reader to save."""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def blocks(page: str) -> list[str]:
    """The shell blocks of a page."""
    return re.findall(r"```sh\n(.*?)```", page, flags=re.DOTALL)


def commands(page: str) -> list[str]:
    """The lines of all shell blocks, without comments."""
    lines = [line.split(" #")[0].strip() for block in blocks(page) for line in block.splitlines()]
    return [line for line in lines if line]


def files(page: str) -> dict[str, str]:
    """The TOML blocks whose first line names a file."""
    found = re.findall(r"```toml\n# (\S+\.toml): (.*?)```", page, flags=re.DOTALL)
    return {name: f"# {text}" for name, text in found}


def serve(command: str, folder: Path) -> None:
    """Run a command that serves a page until it is interrupted, interrupt it once the page is there; it ends well."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    process = subprocess.Popen(shlex.split(command), cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert "http://127.0.0.1:" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        process.communicate()
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, command


def shell(script: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a script in a folder as a reader does, with this environment's commands; stop at the first failure."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", **variables}
    return subprocess.run(
        ["bash", "-ec", script], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
