"""The page for everyone: WCAG 2.2 AA as far as axe can tell in each state, and a run by keyboard alone."""

from collections.abc import Callable
from importlib.resources import files
from importlib.util import find_spec
from typing import Any

import pytest
from selenium.webdriver.common.keys import Keys

from tests.support.station_feed import ISA, TLX, Message, Swarm
from tests.support.station_page import NEEDS_BROWSER, Page
from tests.support.tiers import first_of, nightly

pytestmark = NEEDS_BROWSER

AXE = find_spec("selenium_axe_python")
TAGS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
RUN = """
const told = ({id, nodes}) => [id, nodes.map(({html, failureSummary}) => html + failureSummary)];
axe.run(document, {runOnly: arguments[0], rules: {"target-size": {enabled: true}}}).then((found) =>
    arguments[1]({violations: found.violations.map(told), passes: found.passes.length})
);
"""
COLOUR = "return getComputedStyle(document.body).backgroundColor"

QUESTION: Message = {"low": 1, "high": 7, "low_text": "not at all", "high_text": "completely", "choices": []}
QUESTIONS = [
    {**QUESTION, "name": "age", "text": "How old are you?", "kind": "number", "required": True},
    {**QUESTION, "name": "sure", "text": "How sure are you?", "kind": "likert", "required": True},
    {
        **QUESTION,
        "name": "hand",
        "text": "Which hand?",
        "kind": "choice",
        "choices": ["left", "right"],
        "required": True,
    },
    {**QUESTION, "name": "why", "text": "Why?", "kind": "text", "required": False},
]


def a_form(name: str, *, hides: bool) -> Message:
    form = {"name": name, "title": "About you", "text": "Please answer.", "question": QUESTIONS}
    return {"kind": "form", "number": 0, "hides": hides, "left_s": None, "form": form}


PROBES: dict[str, Message] = {
    "sheet": {"kind": "sheet"},
    "form": a_form("you", hides=False),
    "passing": a_form("spam", hides=False) | {"left_s": 20.0},
    "sagat": a_form("sagat", hides=True),
    "isa": ISA,
    "tlx": TLX,
}


def violations(page: Page) -> list[Any]:
    """What axe finds, in the light theme and in the dark one."""
    page.driver.execute_script((files("selenium_axe_python") / "axe-core" / "axe.min.js").read_text())
    all_found: list[Any] = []
    colours = set()
    try:
        for theme in ("light", "dark"):
            media = {"features": [{"name": "prefers-color-scheme", "value": theme}]}
            page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
            page.until(lambda: page.driver.execute_script(COLOUR) not in colours)
            colours.add(page.driver.execute_script(COLOUR))
            found = page.driver.execute_async_script(RUN, TAGS)
            assert found["passes"] > 10
            all_found += found["violations"]
    finally:
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    return all_found


def running(page: Page, tab: str) -> None:
    page.at("command-send").click()
    page.asked("command")
    page.at(f"tab-{tab}").click()
    page.until(lambda: page.at(f"panel-{tab}").is_displayed() and page.texts("#inbox-list > li"))


def selected(page: Page) -> None:
    page.press("u")
    page.until(lambda: page.text("map-info").startswith("Agent"))


def helped(page: Page) -> None:
    page.press("?")
    page.until(lambda: page.at("help").is_displayed())


def ended(page: Page) -> None:
    page.feed.send(page.player.swarm.hello(end_text="Thank you."))
    page.until(lambda: page.driver.execute_script("return document.title"))
    page.feed.hang_up()
    page.until(lambda: page.text("status").startswith("the run has ended"))


def everything(page: Page) -> None:
    """The task, a veto, a call for help, and beside them a question in passing."""
    page.feed.send(page.player.swarm.hello(goal="Judge each event.", panels=["help", "inbox", "events", "workload"]))
    page.player.show(101.0, proposal={"delta": 3, "left_s": 9.0}, help="asked")
    page.ask(PROBES["passing"])


def between(page: Page) -> None:
    page.feed.send(page.player.swarm.hello(place=[2, 4]))
    page.player.show(101.0, over=True)
    page.until(lambda: page.at("plain").is_displayed())


STATES: dict[str, Callable[[Page], None]] = {
    **{state: lambda page, state=state: page.ask(PROBES[state]) for state in PROBES},  # type: ignore[misc]
    **{f"{tab} tab": lambda page, tab=tab: running(page, tab) for tab in ("commands", "agents", "events", "notes")},  # type: ignore[misc]
    "selected": selected,
    "help": helped,
    "ended": ended,
    "everything": everything,
    "between": between,
}


SHORTLY = ("form", "tlx", "commands tab", "ended")
"""The states that the gate looks at."""


@pytest.mark.skipif(AXE is None, reason="selenium-axe-python is not installed, which brings axe")
@pytest.mark.parametrize("state", [*SHORTLY, *nightly(*(name for name in STATES if name not in SHORTLY))])
def test_axe_finds_nothing(page: Page, state: str) -> None:
    STATES[state](page)
    assert violations(page) == []


@pytest.mark.skipif(AXE is None, reason="selenium-axe-python is not installed, which brings axe")
@pytest.mark.parametrize("kind", first_of(["researcher", "replay", "conductor"]))
def test_axe_finds_nothing_on_other_pages(open_page: Callable[..., Page], kind: str) -> None:
    """The pages of a replay, of the researcher and of the conductor."""
    page = open_page(Swarm(kind))
    page.until(lambda: page.texts("#agents-list > li"))
    assert violations(page) == []


def test_a_run_by_keyboard_alone(page: Page) -> None:
    """Consent, a form, ISA, an order, a note, NASA-TLX with weights; what has the focus shows it."""

    def press(*keys: str) -> None:
        page.press(*keys)
        outline = page.driver.execute_script("return getComputedStyle(document.activeElement).outlineStyle")
        assert outline != "none" or page.driver.execute_script("return document.activeElement === document.body")

    def done(kind: str) -> Message:
        page.until(lambda: not page.at(kind).is_displayed())
        return page.asked(kind)

    page.ask(PROBES["sheet"])
    press(Keys.TAB, Keys.TAB, Keys.SPACE, Keys.TAB, Keys.TAB, Keys.TAB, Keys.ENTER)
    assert done("sheet")["consent"] is True
    page.ask(PROBES["form"])
    press(
        Keys.TAB,
        Keys.TAB,
        "30",
        Keys.TAB,
        Keys.SPACE,
        Keys.ARROW_RIGHT,
        Keys.TAB,
        Keys.SPACE,
        Keys.TAB,
        Keys.TAB,
        Keys.ENTER,
    )
    assert page.asked("form")["answers"] == {"age": 30, "sure": 2, "hand": "left"}
    page.player.swarm.probe = None
    page.player.show(101.5)
    page.until(lambda: not page.at("form").is_displayed())
    page.ask(PROBES["isa"])
    press("4")
    assert done("isa")["answer"] == 4
    press("c")
    press("attend", Keys.TAB, Keys.TAB, "40.5", Keys.TAB, "12", Keys.ENTER)
    assert page.asked("command")["target"] == {"kind": "place", "x_m": 40.5, "y_m": 12}
    press(Keys.ESCAPE, "n")
    press("a note", Keys.TAB, Keys.ENTER)
    assert page.asked("note")["text"] == "a note"
    page.ask(PROBES["tlx"])
    press(Keys.TAB)
    for _ in range(6):
        press(Keys.ARROW_RIGHT, Keys.TAB)
    press(Keys.ENTER, Keys.TAB)
    for _ in range(15):
        press(Keys.SPACE, Keys.TAB)
    page.press(Keys.ENTER)
    answers = done("tlx")
    assert set(answers["scales"].values()) == {55}
    assert sorted(answers["weights"].values()) == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("state", first_of(["tlx", "sheet", "form", "sagat", "passing", "isa"]))
def test_nothing_scrolls_sideways(page: Page, state: str) -> None:
    """Neither a dialog nor the page: on a usual screen, at 200 % of one, on a tablet and on a telephone."""
    page.ask(PROBES[state])
    within = f"#{PROBES[state]['kind']}"
    wide = f"return [...document.querySelectorAll('{within}, {within} *')].filter((e) => "
    wide += "e.scrollWidth > e.clientWidth + 1 && ['auto', 'scroll'].includes(getComputedStyle(e).overflowX))"
    wide += ".map((e) => e.id || e.className)"
    try:
        for width, height in ((1366, 768), (683, 384), (768, 1024), (390, 844)):
            metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
            page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
            page.until(lambda width=width: page.driver.execute_script("return innerWidth") == width)
            if state != "passing":  # a scale beside the map may be wider than its place
                assert page.driver.execute_script(wide) == [], width
            assert page.driver.execute_script("return document.documentElement.scrollWidth") <= width
    finally:
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
