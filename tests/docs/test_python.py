"""The page on Python: its snippets run in order, as a reader types them."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.pages import ROOT

PAGE = (ROOT / "docs" / "PYTHON.md").read_text()


@pytest.mark.processes
def test_the_snippets_work(tmp_path: Path) -> None:
    """In one script, in which a class is as in a notebook; without any warning of deltaswarm."""
    code = "\n".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL))
    (tmp_path / "page.py").write_text(code.replace("600.0", "60.0"))
    done = subprocess.run(
        [sys.executable, "page.py"],
        env={**os.environ, "MPLBACKEND": "agg"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "radio.loss must be a number from 0 to 1 (got 2.0)" in done.stdout
    assert "Warning" not in done.stderr
    assert {"swarm.png", "smoke.mcap", "sweeps"} <= {path.name for path in tmp_path.iterdir()}
