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
    page.press("X")  # as Caps Lock makes it
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


DOTS = """
const arc = CanvasRenderingContext2D.prototype.arc;
window.dots = [];
CanvasRenderingContext2D.prototype.arc = function (x, y, radius, ...rest) {
    if (this.canvas.id === "map" && radius === 3.5) window.dots.push([x, y]);
    return arc.call(this, x, y, radius, ...rest);
};
"""
COLOURS = """
const map = document.getElementById("map");
const on = new OffscreenCanvas(map.width, map.height).getContext("2d", { willReadFrequently: true });
on.drawImage(map, 0, 0);
return window.dots.map(([x, y]) => [...on.getImageData(Math.round(x), Math.round(y), 1, 1).data]);
"""


def test_no_mark_covers_the_places_at_which_the_selected_event_was_reported(page: Page) -> None:
    """Agents stand where an event is, and so do their labels: the cue of the task is drawn over both."""
    hello(page, goal="Find the targets.")
    page.until(lambda: page.at("judge").is_displayed())
    page.driver.execute_script(DOTS)
    trail = [[50.0 + 1.5 * at, 50.0 - at % 2] for at in range(6)]
    agents = [[at, *trail[at % 6], "attending", -1, -1, 101, 1, 0] for at in range(12)]
    page.player.show(101.0, agents=agents, events=[[0, 52.0, 50.0, 90.0, 101.0, 0, [0, 1], trail]])
    page.until(lambda: page.text("time") == "1:41")
    page.driver.execute_script("window.dots = []")
    page.press("l", "l")
    page.drawn()
    colours = page.driver.execute_script(COLOURS)
    assert len(colours) >= len(trail)
    assert all(blue > green + 40 and red > green + 20 for red, green, blue, _ in colours), colours
