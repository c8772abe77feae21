"""Who has which page: the participant, watchers, and the conductor of an experiment."""

from collections.abc import Iterator

import pytest
from selenium import webdriver

from tests.support.station_feed import Feed, Swarm
from tests.support.station_page import NEEDS_BROWSER, Page

pytestmark = NEEDS_BROWSER


@pytest.fixture
def watcher(driver: webdriver.Chrome) -> Iterator[Page]:
    """The page of somebody who has the watchers' address alone."""
    with Feed() as feed:
        yield Page(driver, Swarm(), feed, feed.watch_url)
        driver.get("about:blank")


def test_a_watcher_sees_everything_and_can_do_nothing(watcher: Page) -> None:
    """Map, inbox and orders; no pace, no notes, and questions are told of, not asked."""
    page = watcher
    page.until(lambda: len(page.texts("#inbox-list > li")) == 50 and page.texts("#agents-list > li"))
    assert page.text("role") == "You only watch"
    for name in ("pause", "step", "speed", "command-form", "tab-notes", "inbox-all-read"):
        assert not page.at(name).is_displayed(), name
    page.press("u", "p", "R")
    page.until(lambda: page.text("map-info").startswith("Agent 2"))
    page.player.swarm.probe = {"kind": "isa", "number": 3, "asked_s": 90.0, "left_s": 21.0}
    page.player.show(101.0)
    page.until(lambda: page.text("role") == "You only watch. The participant is asked: ISA (question 4)")
    page.press("3")
    assert not page.at("isa").is_displayed()
    page.player.swarm.probe = {"kind": "sheet"}
    page.player.show(102.0)
    page.until(lambda: page.text("role").endswith("is asked: to consent"))
    assert not page.at("sheet").is_displayed()
    assert page.player.intents == []


def test_a_watcher_does_not_see_what_a_question_hides(watcher: Page) -> None:
    """Or a word from behind would help the participant."""
    form = {"name": "sagat", "title": "What is the situation?", "text": "", "question": []}
    watcher.player.swarm.probe = {"kind": "form", "number": 0, "hides": True, "form": form}
    watcher.player.show(101.0)
    watcher.until(lambda: not watcher.at("map").is_displayed())
    watcher.player.swarm.probe = None
    watcher.player.show(102.0)
    watcher.until(lambda: watcher.at("map").is_displayed())
