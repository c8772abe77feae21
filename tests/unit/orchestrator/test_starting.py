"""The start of processes while stop signals come."""

import signal
import subprocess
import sys

import pytest

from deltaswarm_orchestrator.base.signals import spared_by_ctrl_c, starting_processes


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("fails", [False, True])
def test_a_signal_waits_until_processes_have_started(number: signal.Signals, fails: bool) -> None:
    """And is the reason then, whatever else went wrong meanwhile."""
    before = signal.getsignal(number)
    done = []

    def start() -> None:
        with starting_processes():
            signal.raise_signal(number)
            done.append("all")
            if fails:
                raise RuntimeError("Nanny failed to start.")

    with pytest.raises(KeyboardInterrupt):
        start()
    assert done == ["all"]
    assert signal.getsignal(number) is before


def test_without_a_signal_an_error_is_itself() -> None:
    """Nothing is swallowed."""
    with pytest.raises(RuntimeError, match="full"), starting_processes():
        raise RuntimeError("full")


def test_what_is_started_is_not_reached_by_ctrl_c() -> None:
    """By blocking it, which programs that are started inherit; this process can be interrupted again afterwards."""
    with spared_by_ctrl_c():
        started = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    started.send_signal(signal.SIGINT)
    started.communicate(b"\n")
    assert started.returncode == 0
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
