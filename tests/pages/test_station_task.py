"""The participant's task on the page: which event is next, and its judgement beside it on the map."""

from selenium.webdriver.common.keys import Keys

from tests.pages.test_station_study import hello
from tests.support.station_page import NEEDS_BROWSER, Page

pytestmark = NEEDS_BROWSER


def test_a_reported_event_is_judged_by_buttons_and_by_keys(page: Page) -> None:
    """The oldest that is not judged is selected by itself, then the next; the list says how each was judged."""
    page.press("x")
    hello(page, goal="Find the targets.")
    page.until(lambda: page.text("goal") == "Find the targets." and page.at("judge").is_displayed())
    page.until(lambda: page.text("judge-event") == "Event 0 is" and page.text("judge-count") == "5 to judge")
    assert page.player.heard(
        lambda intent: intent.get("event") == "selected" and intent.get("text") == "event 0 by itself"
    )
    page.at("tab-events").click()
    page.until(lambda: page.texts("#events-list > li"))
    page.press("z")
    assert page.asked("judge") == {"type": "judge", "event": 0, "answer": "decoy"}
    page.until(lambda: page.text("judge-count") == "4 to judge")
    page.press(Keys.ESCAPE)
    page.until(lambda: not page.at("judge").is_displayed())
    page.player.show(101.0)  # who selects nothing is left alone
    page.press("w")
    page.until(lambda: page.text("judge-event") == "Event 1 is")
    page.at("judge-next").click()
    page.until(lambda: page.text("judge-event") == "Event 2 is")
    page.at("judge-decoy").click()
    assert page.asked("judge") == {"type": "judge", "event": 2, "answer": "decoy"}
    page.press("x")
    assert page.asked("judge") == {"type": "judge", "event": 2, "answer": "target"}
    page.until(lambda: page.at("judge-target").get_attribute("aria-pressed") == "true")
    assert page.at("judge-decoy").get_attribute("aria-pressed") == "false"
    page.until(lambda: "Judged: target" in page.texts('#events-list [data-key="2"] .what')[0])
    hello(page, goal="")
    page.until(lambda: not page.at("task").is_displayed())


def test_an_event_is_not_judged_after_the_end(page: Page) -> None:
    hello(page, goal="Find the targets.")
    page.at("tab-events").click()
    page.until(lambda: page.texts("#events-list > li"))
    page.all('#events-list [data-key="2"] button')[0].click()
    page.until(lambda: page.at("judge").is_displayed())
    page.player.swarm.over = True
    page.player.show(101.0)
    page.until(lambda: not page.at("judge").is_displayed())
    page.press("x", "n")
    page.player.heard(lambda intent: intent["type"] == "page" and intent.get("text") == "tab-notes")
    assert not any(intent["type"] == "judge" for intent in page.player.intents)
