"""What a part tells the process that started it: that it is ready, and why it ended (exit code, last words).

A part that fails logs the reason, and nothing else, at level CRITICAL. It says that it is ready on a pipe of its own:
libraries write to standard output, such as Zenoh with RUST_LOG in the environment.
"""

import errno
import os
import sys
import threading
import time
from collections.abc import Callable

READY_VARIABLE = "DELTASWARM_READY_FD"
"""The environment variable with the file descriptor of the pipe; without it standard output is used."""


def say_ready(text: str) -> None:
    """Write one line, and close the pipe."""
    descriptor = os.environ.pop(READY_VARIABLE, None)
    if descriptor is None:
        print(text, flush=True)
        return
    with open(int(descriptor), "w", encoding="utf-8") as pipe:
        pipe.write(f"{text}\n")


FAILED = 1

NO_ROOM = 74
"""A file could not be written: the disk is full or faulty (`EX_IOERR` of sysexits.h)."""

WORLD_LOST = 69
"""An operator's world, or the link to it, went before the last step (`EX_UNAVAILABLE` of sysexits.h)."""

PLUGIN_FAILED = 70
"""A plug-in raised or returned something invalid, and would again (`EX_SOFTWARE` of sysexits.h)."""

LIMIT_REACHED = 71
"""The system allows no more processes, threads, open files or memory (`EX_OSERR` of sysexits.h)."""

GAVE_UP = 75
"""The world ended the run in order, since another part kept it waiting; its last words name that part."""

ENDED_BY_CONDUCTOR = 80
"""The operator ended in order, since the conductor of the experiment ended the run."""

_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG, errno.EROFS}


def ended_by(number: int) -> int:
    """The exit code of a part that ends in order, before its work is done, because a signal asks it to."""
    return 128 + number


def exit_code_of(error: Exception) -> int:
    return NO_ROOM if isinstance(error, OSError) and error.errno in _DISK else FAILED


THREADS_END_WITHIN_S = 1.0
"""Time that threads have to end by themselves when the process is about to exit [s]."""


def leave(code: int, finish: Callable[[], None] = lambda: None) -> None:
    """End the child processes of a plug-in, and this process if a plug-in's thread would keep it alive.

    `finish` is called before, for what Python would do at exit.
    """
    deadline = time.monotonic() + THREADS_END_WITHIN_S
    if multiprocessing := sys.modules.get("multiprocessing"):
        for child in multiprocessing.active_children():
            child.kill()
    own = threading.current_thread()
    for thread in (left := [thread for thread in threading.enumerate() if thread is not own and not thread.daemon]):
        thread.join(max(0.0, deadline - time.monotonic()))
    if not (names := [thread.name for thread in left if thread.is_alive()]):
        return
    print(f"ended while threads of a plug-in were still running: {', '.join(names)}", file=sys.stderr)
    try:
        finish()
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
    finally:
        os._exit(code)
