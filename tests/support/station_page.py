"""The station's page in a browser, as a person has it, for tests."""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from selenium import webdriver
from selenium.common.exceptions import NoSuchElementException, StaleElementReferenceException
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from deltaswarm_scenario.page_messages import INPUT, SHOWN
from tests.support.station_feed import PATIENCE_S, Feed, Message, Player, Swarm

CHROMIUM, DRIVER = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
MISSING = "chromium and chromedriver are not installed (Debian: chromium, chromium-driver)"
NEEDS_BROWSER = [pytest.mark.processes, pytest.mark.skipif(not (CHROMIUM and DRIVER), reason=MISSING)]


@contextmanager
def browser(*, insecure: bool = False) -> Iterator[webdriver.Chrome]:
    """Chromium without a window, and without the temporary folder that it leaves behind.

    `insecure`: it takes any certificate.
    """
    options = webdriver.ChromeOptions()
    options.accept_insecure_certs = insecure
    options.binary_location = CHROMIUM or ""
    for switch in ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--window-size=1366,768"):
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:  # short: it takes a socket, whose path is limited
        service = webdriver.ChromeService(DRIVER, env={**os.environ, "TMPDIR": folder})
        with webdriver.Chrome(options=options, service=service) as made:
            yield made


DRAWN = (
    "requestAnimationFrame(() => requestAnimationFrame("
    "() => arguments[1](document.querySelector(arguments[0]).toDataURL())))"
)
"""A script that calls back with a canvas's picture, once it is painted."""


class Looking:
    """The page as a person has it."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    def until(self, holds: Callable[[], Any]) -> Any:
        """Wait for something to hold; elements may go while they are looked at, as when the page loads again."""
        not_there = [StaleElementReferenceException, NoSuchElementException]
        waiting = WebDriverWait(self.driver, PATIENCE_S, 0.05, not_there)
        return waiting.until(lambda _: holds())

    def at(self, name: str) -> WebElement:
        """An element by its id."""
        return self.driver.find_element(By.ID, name)

    def all(self, selector: str) -> list[WebElement]:
        """Elements by a CSS selector."""
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def text(self, name: str) -> str:
        """An element's text, whether or not it is on the screen."""
        return str(self.at(name).get_property("textContent"))

    def texts(self, selector: str) -> list[str]:
        """The texts of all elements, at one moment."""
        script = "return [...document.querySelectorAll(arguments[0])].map((found) => found.textContent)"
        return list(self.driver.execute_script(script, selector))  # type: ignore[no-untyped-call]

    def drawn(self, canvas: str = "#map") -> str:
        """A canvas as it is painted."""
        return str(self.driver.execute_async_script(DRAWN, canvas))

    def press(self, *keys: str) -> None:
        """Keys, to whatever has the focus."""
        ActionChains(self.driver).send_keys(*keys).perform()


class Page(Looking):
    """The page as a person has it, and the operator behind it."""

    def __init__(self, driver: webdriver.Chrome, swarm: Swarm, feed: Feed, url: str = "") -> None:
        super().__init__(driver)
        self.feed = feed
        self.player = Player(feed, swarm)
        driver.get(url or feed.url)
        self.until(lambda: self.text("status") != "connecting")

    def asked(self, kind: str) -> Message:
        """What the page sent, without the browser's number."""
        intent = self.player.heard(lambda intent: intent["type"] == kind)
        return {name: value for name, value in intent.items() if name not in ("from", *INPUT, *SHOWN)}

    def ask(self, probe: Message, time_s: float = 101.0) -> None:
        """Ask a question, and wait until the page shows it."""
        self.player.swarm.probe = probe
        self.player.show(time_s)
        self.until(lambda: self.at(probe["kind"]).is_displayed())

    @property
    def scale(self) -> float:
        """Pixels per metre of the fitted map."""
        size = self.at("map").size
        return min((size["width"] - 28) / 100, (size["height"] - 28) / 100)

    def click_map(self, x_m: float, y_m: float) -> None:
        """Click at a place of the arena, by the scale that the fitted map has."""
        scale = self.scale
        x, y = round((x_m - 50) * scale), round((50 - y_m) * scale)
        ActionChains(self.driver).move_to_element_with_offset(self.at("map"), x, y).click().perform()
