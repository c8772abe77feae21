"""The files of the station's page: typed, short, without HTML made from data, and what is vendored is licensed."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from deltaswarm_operator.station.server import PAGE

CHECKS = ["--noEmit", "--allowJs", "--checkJs", "--strict", "--noUncheckedIndexedAccess", "--noUnusedLocals"]
CHECKS += ["--target", "es2022", "--module", "es2022", "--lib", "es2022,dom,dom.iterable"]


@pytest.mark.skipif(not shutil.which("tsc"), reason="tsc is not installed (Debian: node-typescript)")
def test_the_pages_types_hold() -> None:
    files = [*map(str, sorted(PAGE.glob("*.d.ts"))), *map(str, sorted(PAGE.glob("*.js")))]
    done = subprocess.run(["tsc", *CHECKS, *files], cwd=os.sep, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_pages_files_are_short_and_set_no_html() -> None:
    """Each says what it is; what comes from a run is only ever set as text."""
    for path in sorted([*PAGE.glob("*.js"), *PAGE.glob("*.css"), *PAGE.glob("*.html")]):
        text = path.read_text()
        assert text.count("\n") < 350, path.name
        assert path.suffix == ".html" or text.startswith(("/** ", "/* ")), path.name
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text), (
            path.name
        )
        assert not re.search(r"https?://", text), path.name


def test_what_is_vendored_has_its_licence() -> None:
    vendor: Path = PAGE / "vendor"
    assert "(v1.6." in (vendor / "uPlot.iife.min.js").read_text()[:100]
    assert "MIT" in (vendor / "uPlot.LICENSE").read_text()
