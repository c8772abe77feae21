"""How every rule is compiled: once per machine and version, with plain IEEE arithmetic, without counting references.

Arrays live longer than a call, so that counting references, in each access to each of them, would take half the time.
A function that would make an array cannot be compiled so. All rules become part of `step.advance`, which alone can be
called from Python, and alone is kept on disk.

Numba looks only at the file of the function that it keeps, so the folder is named after all of deltaswarm's code.
"""

import fcntl
import os
import platform
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import notice

njit: Any = numba.njit  # its types know neither the options of wrappers and counting, nor the settings
settings: Any = config

KEPT = 4
"""Compiled versions that are kept on disk."""

_rule = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}

compiled = njit(**_rule)

inlined = njit(forceinline=True, **_rule)
"""For what is called for every agent in every step, or for every number that is written."""


def entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, without the interpreter's lock; keep it on disk."""
    before, settings.CACHE_DIR = settings.CACHE_DIR, str(cache_folder())
    try:
        return njit(cache=True, nogil=True, no_cfunc_wrapper=True, _nrt=False)(function)
    finally:
        settings.CACHE_DIR = before


def compile_once(what: str, run: Callable[[], object]) -> None:
    """Compile by a run, unless this machine's code is on disk; of several processes one does, and the others wait."""
    folder = cache_folder()
    versions = numba.__version__, platform.python_version()
    done = folder / f"{what}-{'-'.join(versions)}-{platform.node()}"
    if done.exists():
        return
    folder.mkdir(parents=True, exist_ok=True)  # runs of other versions may have removed it since
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not done.exists():
            notice(f"compiling the {what} for this machine: one to two minutes, once")
            run()
            done.touch()


@cache
def cache_folder() -> Path:
    """Return the folder for this version's compiled code: in the user's cache, or else among temporary files."""
    version = provenance.code_digest()
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "deltaswarm" / "dense"
    try:
        (base / version).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base / version):
            pass
    except OSError:
        base = Path(tempfile.gettempdir()) / f"deltaswarm-dense-{os.getuid()}"
        base.mkdir(mode=0o700, exist_ok=True)
        if base.stat().st_uid != os.getuid():  # what is kept there is code
            base = Path(tempfile.mkdtemp(prefix="deltaswarm-dense-"))
        (base / version).mkdir(exist_ok=True)
    (base / version).touch()
    with suppress(OSError):
        for old in sorted(base.iterdir(), key=lambda folder: folder.stat().st_mtime, reverse=True)[KEPT:]:
            shutil.rmtree(old, ignore_errors=True)
    return base / version
