"""The page as an instrument: nothing passes from one run to the next, and what happens to it is noted."""

import time
from collections.abc import Callable
from typing import Any

import pytest
from selenium.webdriver.common.keys import Keys

from tests.support.station_feed import ISA, Swarm
from tests.support.station_page import NEEDS_BROWSER, Page
from tests.support.tiers import first_of

pytestmark = NEEDS_BROWSER


def hello(page: Page, **changes: Any) -> None:
    page.feed.send(page.player.swarm.hello(**changes))


def screen(page: Page, width: int, height: int, scale: float = 1.0) -> None:
    metrics = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": False}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    page.until(lambda: page.driver.execute_script("return innerWidth") == width)


@pytest.mark.parametrize("size", first_of([(390, 844), (1366, 768), (683, 384), (768, 1024)]))
def test_every_answer_to_isa_is_within_the_window(page: Page, size: tuple[int, int]) -> None:
    width, height = size
    screen(page, width, height)
    page.ask(ISA)
    rects = [answer.rect for answer in page.all("#isa [data-answer]")]
    shown = page.driver.execute_script("return document.documentElement.scrollWidth")
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert len(rects) == 5
    assert all(rect["x"] >= 0 and rect["x"] + rect["width"] <= width for rect in rects)
    assert all(rect["width"] >= 40 for rect in rects), rects
    assert shown <= width


def test_no_draft_reaches_the_next_participant(page: Page) -> None:
    """A note and sliders that were moved and not sent stay with their run; there they are after a reload."""
    questions = {"sheet": None}
    hello(page, run="first", session=questions)
    page.at("tab-notes").click()
    page.at("note-text").send_keys("tired")
    page.ask({"kind": "tlx"})
    page.driver.execute_script(
        "const s = document.getElementById('tlx-mental'); s.value = 95; s.dispatchEvent(new Event('input'))"
    )
    page.player.swarm.probe = None
    hello(page, run="second", session=questions)
    page.player.show(1.0)
    page.until(lambda: not page.at("tlx").is_displayed() and page.at("note-text").get_property("value") == "")
    page.ask({"kind": "tlx"})
    assert page.at("tlx-mental").get_attribute("data-answered") == "false"
    assert page.at("tlx-mental").get_property("value") == "50"
    page.player.swarm.probe = None
    hello(page, run="first", session=questions)
    page.player.show(1.0)
    page.until(lambda: page.at("note-text").get_property("value") == "tired")
    page.ask({"kind": "tlx"})
    assert page.at("tlx-mental").get_property("value") == "95"


def test_the_first_question_of_the_next_run_is_asked(page: Page) -> None:
    """Though it has the number of one that was answered in the run before."""
    for run in ("first", "second"):
        hello(page, run=run)
        page.ask({"kind": "isa", "number": 0, "asked_s": 90.0, "left_s": 21.0})
        page.press("2")
        assert page.asked("isa")["answer"] == 2
        page.player.swarm.probe = None
        page.player.show(102.0)
        page.until(lambda: not page.at("isa").is_displayed())


def test_the_sheet_of_a_session_cannot_be_changed(page: Page) -> None:
    sheet = {"consent": "Yes", "participant": "P001", "condition": "1 A"}
    hello(page, run="planned", session={"sheet": sheet})
    page.ask({"kind": "sheet"})
    for name in ("participant", "condition"):
        field = page.at(f"sheet-{name}")
        field.send_keys("9")
        assert field.get_property("value") == sheet[name]
    page.at("sheet-agree").click()
    page.at("sheet-begin").click()
    assert page.asked("sheet") == {"type": "sheet", "participant": "P001", "condition": "1 A", "consent": True}


def test_what_a_run_leaves_out_is_not_on_the_page(page: Page) -> None:
    hello(page, run="bare", speeds=[], layers=["trees"])
    page.player.show(1.0)
    page.until(lambda: not page.at("pause").is_displayed())
    assert not page.at("speed").is_displayed()
    assert not page.at("layer-heat").is_displayed()
    assert page.at("layer-trees").is_displayed()
    page.press("h")
    assert page.at("layer-heat").get_property("checked") is False


def test_what_happens_to_the_page_is_noted(page: Page) -> None:
    """Loaded, its size, what is selected, which tab, how far it is zoomed; once each, when it changes."""

    def noted(event: str) -> str:
        intent = page.player.heard(lambda intent: intent["type"] == "page" and intent["event"] == event)
        return str(intent.get("text", ""))

    assert noted("loaded") == "navigate"
    size = page.driver.execute_script("return `${innerWidth}x${innerHeight}`")
    assert noted("size") == size
    before = noted("zoom")
    page.at("map-in").click()
    assert noted("zoom") != before
    assert noted("tab") == "tab-commands"
    page.at("tab-events").click()
    assert noted("tab") == "tab-events"
    assert noted("selected") == ""
    page.all("#events-list li button, #events-list li")[0].click()
    assert noted("selected").startswith("event ")
    page.driver.refresh()
    assert noted("closed") == ""
    assert noted("opened") == ""
    assert noted("loaded") == "reload"


SMALL = """
const targets = [...document.querySelectorAll("button, select, input, textarea, [role=tab]")];
return targets
    .filter((e) => e.offsetParent)
    .map((e) => [e.id || e.className, (e.closest("label") || e).getBoundingClientRect()])
    .filter(([, box]) => box.width < 24 || box.height < 24)
    .map(([name]) => name);
"""


def test_no_target_is_too_small(page: Page) -> None:
    """24 by 24 pixels at least (WCAG 2.2, 2.5.8), in every tab and in a form."""
    for tab in ("commands", "agents", "events", "notes"):
        page.at(f"tab-{tab}").click()
        page.until(lambda: page.driver.execute_script(SMALL) == [])
    page.ask(a_form(0))
    page.until(lambda: page.driver.execute_script(SMALL) == [])


SITUATION = {
    "name": "sagat",
    "title": "What is the situation?",
    "text": "",
    "question": [
        {"name": "trees", "text": "How many trees?", "kind": "number", "low": 0, "high": 99},
        {"name": "most", "text": "Where?", "kind": "choice", "choices": ["left", "right"]},
        {"name": "sure", "text": "How sure are you?", "kind": "likert", "low": 1, "high": 7, "low_text": "not at all"},
        {"name": "why", "text": "Why?", "kind": "text", "required": False},
    ],
}
DEFAULTS = {"low": 1, "high": 7, "low_text": "", "high_text": "", "choices": [], "required": True}


def a_form(number: int) -> dict[str, Any]:
    questions = [{**DEFAULTS, **question} for question in SITUATION["question"]]  # type: ignore[arg-type]
    form = {**SITUATION, "question": questions}
    return {"kind": "form", "number": number, "hides": True, "left_s": None, "form": form}


def test_a_form_is_filled_in_by_keyboard_while_the_situation_is_hidden(page: Page) -> None:
    """Nothing is sent before all that is required is answered; the next form is empty, a reload keeps answers."""
    page.ask(a_form(0))
    assert not page.at("map").is_displayed()
    assert not page.at("inbox-list").is_displayed()
    assert page.text("form-title") == "What is the situation?"
    page.at("form-send").click()
    page.until(lambda: page.text("form-missing") == "Still to answer: How many trees? Where? How sure are you?")
    page.at("question-0").send_keys("12", Keys.TAB, Keys.SPACE, Keys.TAB, Keys.SPACE, Keys.ARROW_RIGHT)
    loaded_s = time.time()
    page.driver.refresh()
    page.until(lambda: page.at("form").is_displayed() and page.at("question-0").get_property("value") == "12")
    page.at("question-3").send_keys("a guess")
    page.press(Keys.TAB, Keys.ENTER)
    intent = page.player.heard(lambda intent: intent["type"] == "form")
    assert intent["shown_s"] < loaded_s < intent["page_s"]
    page.player.intents.append(intent)
    assert page.asked("form") == {
        "type": "form",
        "form": "sagat",
        "number": 0,
        "answers": {"trees": 12, "most": "left", "sure": 2, "why": "a guess"},
    }
    page.ask(a_form(1), 102.0)
    page.until(lambda: page.at("question-0").get_property("value") == "")
    page.player.swarm.probe = None
    page.player.show(103.0)
    page.until(lambda: page.at("map").is_displayed() and not page.at("form").is_displayed())


def test_what_is_refused_after_the_end_opens_no_answered_form(page: Page) -> None:
    """The page notes by itself how it is used, when the run has ended with the answer."""
    page.ask(
        {
            **a_form(0),
            "hides": False,
            "form": {"name": "score", "title": "Your score", "text": "9", "question": []},
        }
    )
    page.at("form-send").click()
    page.asked("form")
    page.feed.hang_up()
    page.until(lambda: page.at("status").get_attribute("data-state") == "ended")
    page.until(lambda: not page.at("form").is_displayed())
    page.at("tab-agents").click()  # the page notes this, which is refused
    page.press("p")  # what a person wants is refused too, and said
    page.until(lambda: "Not accepted" in page.text("said"))
    assert not page.at("form").is_displayed()


def test_a_question_in_passing_leaves_all_in_view(page: Page) -> None:
    """The map and the shortcuts stay in use beside it, and it goes once its time is over."""
    page.ask({**a_form(0), "hides": False, "left_s": 20.0})
    page.until(lambda: page.text("form-left") == "20 s left")
    page.click_map(50.0, 50.0)
    page.press("u")
    assert page.asked("read")["items"]
    page.player.swarm.probe = None
    page.player.show(102.0)
    page.until(lambda: not page.at("form").is_displayed())


def test_no_question_takes_a_key_that_was_meant_for_something_else(page: Page) -> None:
    """Digits of a note stay in it when a question comes, beside the map or over it; q leads to one beside it."""
    form = {**a_form(0)["form"], "title": "Are you ready?", "question": []}
    page.press("n")
    page.press("1")
    page.ask({**a_form(0), "hides": False, "left_s": 20.0, "prompt": True, "form": form})
    page.press("2")
    assert page.at("note-text").get_property("value") == "12"
    page.player.swarm.probe = {**a_form(0), "hides": False, "left_s": 20.0}
    page.player.show(102.0)
    page.until(lambda: page.texts("#form-questions input"))
    page.press("3")
    page.ask(ISA, 103.0)
    page.press("4")
    assert page.at("note-text").get_property("value") == "1234"
    page.ask(a_form(1), 104.0)
    page.press("5")
    assert page.at("question-0").get_property("value") == ""
    page.player.swarm.probe = {**a_form(2), "hides": False, "left_s": 20.0}
    page.player.show(105.0)
    page.until(lambda: page.at("note-text").is_displayed() and page.at("form").is_displayed())
    page.driver.execute_script("document.activeElement.blur()")
    page.press("q")
    page.press("6")
    assert page.at("question-0").get_property("value") == "6"
    assert page.at("note-text").get_property("value") == "1234"


def test_a_prompt_comes_before_the_question_and_both_are_timed_by_the_page(page: Page) -> None:
    """From the frame that shows each; the question itself is not on the page before the person is ready."""
    form = {**a_form(0)["form"], "title": "Are you ready?", "question": []}
    page.ask({**a_form(0), "hides": False, "left_s": 20.0, "prompt": True, "form": form})
    assert page.text("form-send") == "Ready"
    assert page.texts("#form-questions > *") == []
    page.driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
    page.at("form-send").click()
    ready = page.player.heard(lambda intent: intent["type"] == "ready")
    assert (ready["form"], ready["number"]) == ("sagat", 0)
    assert 0.0 < ready["page_s"] - ready["shown_s"] < 30.0
    assert abs(ready["page_s"] - time.time()) < 30.0
    page.player.swarm.probe = {**a_form(0), "hides": False, "left_s": 20.0}
    page.player.show(102.0)
    page.until(lambda: page.texts("#form-questions input"))


def test_a_scale_has_no_mark_before_the_first_click(page: Page) -> None:
    """Nothing suggests an answer, neither to the eye nor to a screen reader."""
    page.ask({"kind": "tlx"})
    slider = page.at("tlx-mental")
    assert slider.get_attribute("aria-valuetext") == "not answered yet"
    looks = []
    for value in (0, 100):
        page.driver.execute_script("arguments[0].value = arguments[1]", slider, value)
        looks.append(slider.screenshot_as_png)
    assert looks[0] == looks[1]
    slider.click()
    assert slider.get_property("value") == "50"
    assert slider.get_attribute("aria-valuetext") is None
    page.press(Keys.TAB)
    assert slider.screenshot_as_png != looks[0]


ACTIVITY = """
import("./heat.js").then(({ Heat }) => {
    const heat = new Heat();
    heat.start("a run", [48, 48]);
    const cell = (x_m, y_m) => heat.active[y_m * 48 + x_m];
    const row = (id, x_m, said_s) => [id, x_m, 10, "free", -1, -1, said_s, 1, 0];
    const found = {};
    for (let time_s = 0; time_s <= 600; time_s += arguments[0]) heat.take([row(0, 10, time_s), row(1, 30, 0)], time_s);
    Object.assign(found, { stays: cell(10, 10), left: cell(30, 10), elsewhere: cell(20, 10) });
    heat.take([row(0, 10, 600)], 780);
    Object.assign(found, { faded: cell(10, 10) });
    heat.take([], 100);
    arguments[1](Object.assign(found, { back: cell(10, 10) }));
});
"""


def test_activity_is_the_number_of_agents_heard_in_a_place(page: Page) -> None:
    """At any speed of the run; it fades, and a replay that jumps back begins anew."""
    for every_s in (1, 5):
        found = page.driver.execute_async_script(ACTIVITY, every_s)
        assert found["stays"] == pytest.approx(1.0, abs=0.06)
        assert found["left"] < 0.001
        assert found["faded"] == pytest.approx(0.05 * found["stays"], abs=0.01)
        assert found["elsewhere"] == found["back"] == 0
    heard = [[agent, 50.0, 50.0, "attending", -1, -1, 100, 1, 0] for agent in range(3)]
    for now_s, count in ((101.0, 1), (131.0, 2), (161.0, 3)):
        page.player.show(now_s, agents=heard[:count], events=[])
        page.until(lambda count=count: len(page.all("#agents-list li")) == count)
    before = page.drawn()
    page.press("y")
    page.until(lambda: page.drawn() != before and page.at("activity-legend").is_displayed())


@pytest.mark.parametrize("kind", first_of(["live", "replay", "researcher"]))
def test_agents_at_one_place_are_told_apart(open_page: Callable[..., Page], kind: str) -> None:
    """On the map: four at one event, up to a pixel apart, look like four, and each can be selected by a click."""
    page = open_page(Swarm(kind))
    agents = [[agent, 50.0 + agent / 10, 50.0, "attending", -1, -1, 100, 1, 0] for agent in range(4)]

    def show(count: int) -> str:
        truth = {"agents": [[*row[:6], 0] for row in agents[:count]], "events": []}
        page.player.show(101.0, agents=agents[:count], events=[], **({"truth": truth} if kind == "researcher" else {}))
        page.until(lambda: len(page.all("#agents-list li")) == count)
        return page.drawn()

    assert show(1) != show(4)
    chosen = set()
    for x_m, y_m in ((50.0, 53.0), (53.0, 50.0), (50.0, 47.0), (47.0, 50.0)):
        page.click_map(x_m, y_m)
        chosen.add(page.text("map-info").partition(":")[0])
    assert len(chosen) == 4
