"""Accessible to all: axe finds nothing in any state of any page, and a keyboard alone does everything."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver.common.keys import Keys

from tests.support.station_feed import SCALES, TLX, Message, Swarm
from tests.support.station_page import NEEDS_BROWSER, Page
from tests.support.station_picture import ORDERS
from tests.support.tiers import first_of

pytestmark = NEEDS_BROWSER

QUESTIONS: list[Message] = [
    {"name": "open", "text": "How many?", "kind": "number", "low": 0, "high": 99},
    {"name": "sure", "text": "Sure?", "kind": "likert", "low": 1, "high": 7, "low_text": "no", "high_text": "yes"},
]
FORM: Message = {"name": "spam", "title": "A question", "text": "Please answer.", "question": QUESTIONS}
ISA: Message = {"kind": "isa", "number": 3, "asked_s": 90.0, "left_s": 21.0}
PASSING: Message = {"kind": "form", "number": 0, "hides": False, "left_s": 20.0, "form": FORM}
HIDING: Message = {"kind": "form", "number": 1, "hides": True, "left_s": None, "form": FORM}
GOAL = "Judge each event."
TABS = ("tab-commands", "tab-agents", "tab-events", "tab-notes", "tab-acts")

STATES: list[tuple[str, list[tuple[Message, Message]]]] = [
    (
        "live",
        [
            ({"goal": GOAL}, {}),
            ({"panels": ["help"]}, {"probe": ISA, "help": "asked"}),
            ({}, {"probe": PASSING, "proposal": {"delta": 3, "left_s": 9.0}}),
            *[({}, {"probe": probe}) for probe in (HIDING, TLX, {"kind": "sheet"})],
            ({"place": [2, 4]}, {"probe": None, "over": True}),
        ],
    ),
    ("conductor", [({}, {"help": "asked", "next": {"what": "isa", "at_s": 180.0}})]),
    ("replay", [({}, {})]),
    ("researcher", [({}, {})]),
]
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
RUN = """
const [rules, tell] = arguments;
axe.run(document, { runOnly: rules }).then(({ violations }) =>
    tell(violations.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.target.join(" "))}`)));
"""


def axe() -> Path | None:
    """The script of axe-core, if a package that brings it is installed; playwright itself is not used."""
    spec = importlib.util.find_spec("axe_playwright_python")
    return Path(spec.submodule_search_locations[0]) / "axe.min.js" if spec and spec.submodule_search_locations else None


@pytest.mark.slow
@pytest.mark.skipif(axe() is None, reason="axe-playwright-python is not installed (pip, with --no-deps)")
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", [kind for kind, _ in STATES])
def test_axe_finds_nothing(open_page: Callable[..., Page], kind: str, scheme: str) -> None:
    """In all tabs, dark and light: WCAG 2.2 A and AA, and good practice."""
    page = open_page(Swarm(kind, commands=ORDERS))
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    script = axe()
    assert script is not None
    page.driver.execute_script(script.read_text())
    for changes, shown in dict(STATES)[kind]:
        page.feed.send(page.player.swarm.hello(**changes))
        page.player.swarm.probe = shown.get("probe")
        page.player.show(101.0, **shown)
        acts = [{"time_s": 70.0, "kind": "judge", "name": "decoy", "event": 2}]
        page.feed.send({"type": "acts", "acts": acts, "is_first": True})
        page.until(lambda: page.text("time") in ("1:41", "1:42"))  # the last step counts in full
        for tab in TABS:
            page.driver.execute_script("document.getElementById(arguments[0]).click()", tab)
            page.drawn()
            assert page.driver.execute_async_script(RUN, RULES) == [], (shown, tab)
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_a_keyboard_alone_does_a_whole_run(page: Page) -> None:
    """The sheet, judgements, ISA, a question beside the map, a note, and NASA-TLX."""

    def asks(probe: Message | None, time_s: float, **changes: Any) -> None:
        page.player.swarm.probe = probe
        page.player.show(time_s, **changes)

    page.feed.send(page.player.swarm.hello(goal=GOAL))
    asks({"kind": "sheet"}, 0.0)
    page.until(lambda: page.at("sheet").is_displayed())
    page.press(Keys.TAB, Keys.TAB, Keys.SPACE, Keys.TAB, Keys.TAB, Keys.TAB, Keys.ENTER)
    assert page.asked("sheet")["consent"] is True
    page.player.show(101.0)
    page.until(lambda: page.text("judge-event") == "Event 0 is")
    page.press("x", "w")
    assert page.asked("judge") == {"type": "judge", "event": 0, "answer": "target"}
    page.until(lambda: page.text("judge-event") == "Event 1 is")
    page.press("z")
    assert page.asked("judge") == {"type": "judge", "event": 1, "answer": "decoy"}
    asks(ISA, 102.0)
    page.until(lambda: page.at("isa").is_displayed())
    page.press("4")
    assert page.asked("isa")["answer"] == 4
    asks(PASSING, 103.0)
    page.until(lambda: page.at("form").is_displayed())
    page.press("q", "7", Keys.TAB, Keys.SPACE, Keys.ARROW_RIGHT, Keys.TAB, Keys.ENTER)
    assert page.asked("form")["answers"] == {"open": 7, "sure": 2}
    page.until(lambda: not page.at("form").is_displayed())
    page.press("n")
    page.press("done", Keys.TAB, Keys.ENTER)
    assert page.asked("note")["text"] == "done"
    asks({"kind": "tlx"}, 104.0)
    page.until(lambda: page.at("tlx").is_displayed())
    page.press(*[key for _ in SCALES for key in (Keys.TAB, Keys.ARROW_RIGHT)], Keys.TAB, Keys.ENTER)
    assert page.asked("tlx")["scales"] == dict.fromkeys(SCALES, 55)


@pytest.mark.parametrize("size", first_of([(390, 844), (683, 384)]))
def test_a_small_screen_scrolls_one_way_only(page: Page, size: tuple[int, int]) -> None:
    """A telephone, and 200 % of a usual screen: nothing is wider than the window, in no tab and with no question."""
    metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    page.feed.send(
        page.player.swarm.hello(goal=GOAL, panels=["help", "inbox", "events", "workload", "agents", "notes"])
    )
    for probe in (None, ISA, PASSING, HIDING, TLX, {"kind": "sheet"}):
        page.player.swarm.probe = probe
        page.player.show(101.0)
        page.drawn()
        assert page.driver.execute_script("return document.documentElement.scrollWidth") <= size[0], probe
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
