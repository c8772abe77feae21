"""Who has which page: the participant, watchers, and the conductor of an experiment."""

from collections.abc import Callable, Iterator

import pytest
from selenium import webdriver
from selenium.webdriver.common.keys import Keys

from tests.support.station_feed import ISA, Feed, Swarm
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
    page.player.swarm.probe = ISA
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


ACT = {"time_s": 99.0, "by": "person", "kind": "page"}


@pytest.fixture
def conductor(open_page: Callable[..., Page]) -> Page:
    """The conductor's page; agent 9 is silent, and one event more is there than the participant knows."""
    page = open_page(Swarm("conductor"))
    page.feed.send(page.player.swarm.hello(event_numbers=[[700, 1]]))
    truth = page.player.swarm.truth(100.0)
    events = [[700, 20.0, 25.0, 3.0], [701, 80.0, 80.0, 90.0]]
    page.feed.send({"type": "truth", "time_s": 100.0, **truth, "events": events})
    page.until(lambda: page.all('#agents-list [data-agent="9"]'))
    return page


def test_the_conductor_sees_the_truth_beside_what_the_participant_knows(conductor: Page) -> None:
    """An event has the participant's number; one that the participant does not know has a name of its own."""
    page = conductor
    first, second = page.until(lambda: page.texts("#events-list > li"))
    assert first.startswith(
        "event 1at (20, 25) m, since 0:03. Participant: known for 80 s, reported 11 s ago by agent 6, "
    )
    assert second == "event u2at (80, 80) m, since 1:30. Participant: does not know of it"
    assert page.texts('#agents-list [data-agent="9"]')[0].endswith("Participant: never heard of it")
    page.at("layer-truth").click()
    page.until(lambda: not page.all('#agents-list [data-agent="9"]'))
    assert len(page.texts("#events-list > li")) == 5


def test_the_conductor_sees_the_situation_while_a_question_hides_it_from_the_participant(conductor: Page) -> None:
    form = {"name": "sagat", "title": "What is the situation?", "text": "", "question": []}
    conductor.player.swarm.probe = {"kind": "form", "number": 0, "hides": True, "form": form}
    conductor.player.show(101.0)
    conductor.until(lambda: "What is the situation?" in conductor.text("role"))
    assert conductor.at("map").is_displayed()


def test_the_conductor_sees_what_the_participant_does(conductor: Page) -> None:
    """What is selected, asked and done, as it happens; the conductor may pause and write notes, and does not answer."""
    page = conductor
    before = page.drawn()
    page.feed.send({"type": "act", "act": {**ACT, "name": "selected", "text": "agent 7"}})
    page.until(lambda: page.text("role").endswith("Participant: selected agent 7"))
    page.until(lambda: page.drawn() != before)
    page.feed.send({"type": "act", "act": {"time_s": 99.0, "kind": "isa", "by": "person", "value": 4}})
    page.at("tab-acts").click()
    page.until(lambda: page.texts("#acts-list > li") == ["1:39isa4"])
    page.player.swarm.probe = {"kind": "tlx"}
    page.player.show(101.0)
    page.until(lambda: page.text("role").endswith("is asked: NASA-TLX"))
    assert not page.at("tlx").is_displayed()
    assert not page.at("command-form").is_displayed()
    page.at("pause").click()
    assert page.asked("pace") == {"type": "pace", "paused": True}
    page.press("n")
    page.press("looks tired", Keys.TAB, Keys.ENTER)
    assert page.asked("note")["text"] == "looks tired"
    assert {intent["type"] for intent in page.player.intents} <= {"page"}


def test_the_conductor_knows_who_sits_there_what_comes_next_and_who_calls(conductor: Page) -> None:
    """Participant, run and condition in the heading; a call for help is answered; two presses end the run."""
    page = conductor
    session = {"sheet": None, "participant": "P007", "condition": "2 B"}
    page.feed.send(page.player.swarm.hello(place=[2, 4], session=session))
    page.until(lambda: page.text("title") == "P007 · run 2 of 4 · condition B · paper-25-test")
    page.until(lambda: page.text("title") in page.driver.title)
    page.player.show(101.0, help="asked", next={"what": "isa", "at_s": 180.0})
    page.until(lambda: page.text("role") == "The participant calls for help.")
    assert page.text("next-question") == "Next question: isa at 3:00"
    page.at("help-seen").click()
    assert page.asked("help")["state"] == "seen"
    page.at("run-end").click()
    assert not [intent for intent in page.player.intents if intent["type"] == "end"]
    page.at("run-end").click()
    page.asked("end")


def test_the_participant_calls_for_help(open_page: Callable[..., Page]) -> None:
    """If there is a conductor; the button says what is noted of it, and a second press ends the call."""
    page = open_page()
    page.until(lambda: not page.at("help-me").is_displayed())
    page.feed.send(page.player.swarm.hello(panels=["help"]))
    page.player.show(101.0)
    page.until(lambda: page.at("help-me").is_displayed())
    page.at("help-me").click()
    assert page.asked("help")["state"] == "asked"
    page.player.show(102.0, help="seen")
    page.until(lambda: page.text("help-me") == "Help is on its way")
    page.at("help-me").click()
    assert page.asked("help")["state"] == "over"
