"""What a part says to the process that started it once it is ready.

On a pipe of its own: libraries write to standard output, such as Zenoh with RUST_LOG in the environment.
"""

import os

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
