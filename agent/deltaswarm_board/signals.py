"""Signals that end a board. A separate thread takes them, since the main thread may hang in a body."""

import queue
import signal
import socket
import threading
from collections.abc import Callable

Stop = queue.SimpleQueue[int]
"""Received signals."""

ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def stop_on_signals(on_first: Callable[[], None]) -> Stop:
    """Put each ending signal into the queue, unless it is ignored; call `on_first` at the first one.

    Call this in the main thread. Python runs signal handlers only in the main thread, once it returns to Python code:
    too late if it hangs or blocks. Python's C-level handler, however, writes the signal's number to the wake-up
    descriptor at once, in any thread.
    """
    stop: Stop = queue.SimpleQueue()
    reading, writing = socket.socketpair()
    writing.setblocking(False)

    def take() -> None:
        is_first = True
        while writing.fileno() >= 0:  # which also keeps the descriptor open
            for number in reading.recv(64):
                if number not in ENDING:
                    continue  # for a handler that a body has set
                if is_first:
                    on_first()
                is_first = False
                stop.put(number)

    threading.Thread(target=take, name="signals", daemon=True).start()
    signal.set_wakeup_fd(writing.fileno(), warn_on_full_buffer=False)
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)
    return stop
