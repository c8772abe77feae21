"""For all tests: how properties are searched, what signals do, what is compiled once; and a browser for some."""

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

    from tests.support.station_page import Page

# The gate tries the same few examples each time; `--hypothesis-profile=nightly` tries many, each time others. A loaded
# machine is no failure; a failing example can be pasted from the log.
shared = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
settings.register_profile("gate", shared, max_examples=20, derandomize=True)
settings.register_profile("nightly", shared, max_examples=200, derandomize=False)
settings.load_profile("gate")

# The tests start more than a thousand processes. Without bytecode on disk each would compile deltaswarm anew, which
# takes longer than most of their runs; and pytest would rewrite every test file in every worker.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# OpenBLAS starts a thread per core when numpy is imported, and each spins for a while before it sleeps. Here for this
# process; `deltaswarm` does so for its own.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Imports and thousands of tests make no garbage, but each full collection would look at all of them, in every worker.
gc.disable()

# Whoever starts the tests in the background, or by nohup, has these ignored, and so would every process of a test.
for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)


def pytest_collection_finish() -> None:
    """Collect garbage from now on, of what tests make."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="module")
def driver() -> "Iterator[Chrome]":
    """One browser for a file's tests; each has a station of its own, and so an origin of its own."""
    from tests.support.station_page import browser

    with browser() as made:
        yield made


@pytest.fixture
def open_page(driver: "Chrome") -> "Iterator[Callable[..., Page]]":
    """Opens the page on a swarm; afterwards the browser must have had nothing to complain about."""
    from tests.support.station_feed import Feed, Swarm
    from tests.support.station_page import Page

    pages: list[Page] = []

    def opened(swarm: Swarm | None = None) -> Page:
        pages.append(Page(driver, swarm or Swarm(), Feed()))
        return pages[-1]

    yield opened
    complaints = driver.get_log("browser")  # type: ignore[no-untyped-call]
    driver.get("about:blank")
    for page in pages:
        page.feed.close()
    # A page whose station has ended tries again every second, and the browser notes each refusal.
    assert [each for each in complaints if "ERR_CONNECTION_REFUSED" not in each["message"]] == []


@pytest.fixture
def page(open_page: "Callable[..., Page]") -> "Page":
    """The page on a swarm that is as any."""
    return open_page()
