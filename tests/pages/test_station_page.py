"""The station's page in a real browser: what it shows, what people do in it, and what they do not lose."""

import re
from collections.abc import Callable

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select

from tests.support.station_feed import ISA, PATIENCE_S, SCALES, TLX, Swarm
from tests.support.station_page import NEEDS_BROWSER, Page

pytestmark = NEEDS_BROWSER

MIDDLE_ROW = """
const map = document.querySelector("#map");
const row = new OffscreenCanvas(map.width, 1).getContext("2d");
row.drawImage(map, 0, -Math.round(map.height / 2));
return [...row.getImageData(0, 0, map.width, 1).data];
"""


def test_the_page_shows_what_was_fed_and_nothing_more(page: Page) -> None:
    """Agent 9 was never heard of: it is in no list and in no byte, and its place on the map stays empty."""
    page.until(lambda: page.texts("#agents-list > li"))
    numbers = page.driver.execute_script(
        "return [...document.querySelectorAll('#agents-list > li')].map((li) => +li.dataset.agent)"
    )
    assert numbers == [number for number in range(12) if number != 9]
    assert not page.all('[data-agent="9"]')
    assert not re.search(r"agent 9\b", page.text("agents-list") + page.text("inbox-list") + page.text("command-agent"))
    assert page.text("agents-count") == "11 of 12 heard of"
    assert page.texts("#agents-list > li")[6] == "agent 6at event 1, delta 3, seen 2 min ago"
    assert page.texts("#agents-list > li")[0] == "agent 0root of a tree, 3 known followers, delta 3, seen just now"
    told = "in the tree of agent 0, below agent 1, delta 3, told by agent 0 27 s ago"
    assert page.texts("#agents-list > li")[3] == f"agent 3{told}"
    assert page.text("time") == "1:40"
    assert page.text("title") == "paper-25, hybrid"
    assert (page.text("rate-long"), page.text("senders"), page.text("unread")) == ("2.9", "4", "50")
    assert (page.text("events-closed"), page.text("closed-after")) == ("7", "closed after 62 s each")
    assert page.text("events-open") == str(len(page.texts("#events-list > li")))
    assert page.text("above") == "above 5 for 0:12 · above 2 for 1:20"
    assert "event 0" in page.texts("#events-list > li")[0]
    assert page.texts("#events-list > li")[1].endswith("by agent 6, attended by agent 6")
    page.player.swarm.silent = (2, 9)
    page.player.show(101.0)
    page.until(lambda: not page.all('#agents-list [data-agent="2"]'))
    rows = []
    for radius_m, words in ((0.0, False), (8.0, True)):
        page.feed.send(page.player.swarm.hello(radius_m=radius_m))
        page.player.show(101.0, agents=[[1, 50.0, 50.0, "free", -1, -1, 101, 1, 0]], events=[])
        page.until(
            lambda words=words: ("body" in page.text("map-legend")) == words and page.text("agents-count")[0] == "1"
        )
        page.drawn()
        rows.append(page.driver.execute_script(MIDDLE_ROW))
    changed = [place // 4 for place, (before, after) in enumerate(zip(*rows, strict=True)) if before != after]
    assert changed[-1] - changed[0] == pytest.approx(16.0 * page.scale, abs=3.0), "a body is drawn to scale"


def test_names_are_text(open_page: Callable[..., Page]) -> None:
    """HTML in what a scenario, a report or a person named is shown as it is written, everywhere."""
    evil = '<img src=x onerror="document.title=1"><b>&amp;</b>'
    page = open_page()
    form = {
        "name": evil,
        "help": evil,
        "targets": ["all"],
        "arguments": [{"name": evil, "kind": "text", "unit": evil, "help": evil, "default": evil}],
    }
    hello = page.player.swarm.hello(
        title=evil,
        run=evil,
        commands=[form],
        session={
            "sheet": {"consent": evil, "participant": evil, "condition": evil},
        },
    )
    page.feed.send(hello)
    page.player.show(
        101.0,
        agents=[[1, 2, 3, evil, -1, -1, 100, 1]],
        inbox=[[50, 100, 1, evil, 0, [], True]],
        commands=[[1, evil, ["tree", 0], {evil: evil}, 100, 0, 0, 0, 160, evil, 0, []]],
        probe={"kind": "sheet"},
    )
    page.until(lambda: page.text("title") == evil and evil in page.text("inbox-list") and evil in page.text("fates"))
    assert page.text("sheet-consent") == evil
    assert evil in page.text("agents-list") + page.text("map-legend")
    assert not page.all("img, main b b, [onerror]")


def test_pause_step_and_speed(page: Page) -> None:
    """By mouse and by key; the page shows what the feed says, not what was pressed."""
    page.at("pause").click()
    assert page.asked("pace") == {"type": "pace", "paused": True}
    page.until(lambda: page.text("status") == "paused")
    page.at("step").click()
    assert page.asked("pace") == {"type": "pace", "steps": 1}
    Select(page.at("speed")).select_by_visible_text("as fast as possible")
    assert page.asked("pace") == {"type": "pace", "speed": 0}
    page.driver.execute_script("document.activeElement.blur()")
    page.until(lambda: page.at("speed").get_property("value") == "0")
    page.press("<")
    assert page.asked("pace") == {"type": "pace", "speed": 20}
    page.press("p")
    assert page.asked("pace") == {"type": "pace", "paused": False}
    page.until(lambda: page.text("status") == "live")


@pytest.mark.slow
def test_a_speed_that_is_not_reached_is_told(page: Page) -> None:
    page.until(lambda: (page.player.show(100.0), page.text("speed-reached"))[1] == "now 0×")
    page.at("pause").click()
    page.until(lambda: page.text("speed-reached") == "")


def test_the_inbox(page: Page) -> None:
    page.until(lambda: len(page.texts("#inbox-list > li")) == 50)
    assert page.text("inbox-count") == "50 unread"
    page.press("u")
    assert page.asked("read") == {"type": "read", "items": [49]}
    page.until(lambda: page.all('#inbox-list [data-key="49"][data-read="true"]'))
    page.until(lambda: page.text("map-info").startswith("Agent 2:"))
    Select(page.at("inbox-filter")).select_by_value("roots")
    Select(page.at("inbox-order")).select_by_value("oldest")
    shown = page.texts("#inbox-list > li")
    assert len(shown) == 11
    assert shown[0] == "0:02unread: agent 0root, 3 followers: no eventnew"
    page.at("inbox-all-read").click()
    assert page.asked("read") == {"type": "read", "all": True, "up_to": 49}
    page.until(lambda: page.text("inbox-count") == "all read")


def test_isa_is_answered_by_a_key_or_a_click(page: Page) -> None:
    swarm = page.player.swarm
    swarm.probe = ISA
    page.player.show(101.0)
    page.until(lambda: page.at("isa").is_displayed())
    assert page.text("isa-seconds") == "21 s left"
    page.press("n")
    page.press("4")
    assert page.at("note-text").get_property("value") == "4"
    page.driver.execute_script("document.activeElement.blur()")
    page.press("4")
    assert page.asked("isa") == {"type": "isa", "number": 3, "answer": 4}
    page.until(lambda: not page.at("isa").is_displayed())
    swarm.probe = {"kind": "isa", "number": 4, "asked_s": 110.0, "left_s": 30.0}
    page.player.show(111.0)
    page.until(lambda: page.at("isa").is_displayed())
    page.all('#isa [data-answer="2"]')[0].click()
    assert page.asked("isa") == {"type": "isa", "number": 4, "answer": 2}


def test_help_over_isa_does_not_swallow_its_answer(page: Page) -> None:
    """The time to answer passes while the help is read."""
    page.ask(ISA)
    page.press("?")
    page.until(lambda: page.at("help").is_displayed())
    page.press("5")
    assert page.asked("isa") == {"type": "isa", "number": 3, "answer": 5}


def test_tlx_with_weights_survives_a_reload(page: Page) -> None:
    """Six scales by keyboard, fifteen pairs, and nothing is sent before all are answered."""
    page.ask(TLX)
    page.press(Keys.ESCAPE)
    assert page.at("tlx").is_displayed()
    for count, name in enumerate(SCALES):
        assert page.at(f"tlx-{name}").get_attribute("data-answered") == "false"
        assert not page.at("tlx-send").is_enabled()
        page.at(f"tlx-{name}").send_keys(Keys.HOME, *[Keys.ARROW_RIGHT] * count)
    assert not page.at("tlx-pairs").is_displayed()
    page.at("tlx-send").click()
    assert not page.at("tlx-send").is_enabled()
    assert page.text("tlx-missing") == "Still to answer: 15 of 15 pairs."
    page.driver.refresh()
    page.until(lambda: page.at("tlx").is_displayed())
    assert not page.at("tlx-scales").is_displayed()
    for pair in page.all("#tlx-pairs fieldset"):
        pair.find_elements(By.TAG_NAME, "input")[0].click()
    page.at("tlx-send").click()
    assert page.asked("tlx") == {
        "type": "tlx",
        "scales": {name: 5 * count for count, name in enumerate(SCALES)},
        "weights": {name: 5 - count for count, name in enumerate(SCALES)},
    }
    page.until(lambda: not page.at("tlx").is_displayed())


def test_the_sheet_and_notes(page: Page) -> None:
    page.ask({"kind": "sheet"})
    assert "You may stop at any time" in page.text("sheet-consent")
    assert page.at("sheet-participant").get_property("value") == "P07"
    assert not page.at("sheet-begin").is_enabled()
    page.at("sheet-agree").click()
    page.at("sheet-begin").click()
    assert page.asked("sheet") == {"type": "sheet", "participant": "P07", "condition": "2", "consent": True}
    page.until(lambda: not page.at("sheet").is_displayed())
    page.press("n")
    page.press("the left half is <empty>")
    ActionChains(page.driver).key_down(Keys.CONTROL).send_keys(Keys.ENTER).key_up(Keys.CONTROL).perform()
    assert page.asked("note") == {"type": "note", "text": "the left half is <empty>"}
    page.until(lambda: page.texts("#notes-list > li") == ["1:41the left half is <empty>"])
    page.driver.refresh()
    page.until(lambda: page.texts("#notes-list > li") == ["1:41the left half is <empty>"])


def test_a_reload_in_the_middle_loses_nothing(page: Page) -> None:
    """Messages, which of them were read, rates and orders are all there again, also what a slow browser missed."""
    page.until(lambda: len(page.texts("#inbox-list > li")) == 50)
    page.press("u")
    page.asked("read")
    page.at("command-send").click()
    page.asked("command")
    page.press("n")
    page.press("half a no")
    page.player.show(200.0, inbox=page.player.swarm.items(200.0)[-3:])  # a gap, which the page asks for
    page.until(lambda: len(page.texts("#inbox-list > li")) == 100)
    before = page.texts("#inbox-list > li")
    page.driver.refresh()
    page.until(lambda: page.texts("#inbox-list > li") == before)
    assert page.all('#inbox-list [data-key="49"][data-read="true"]')
    page.until(lambda: "set delta" in page.text("fates"))
    assert page.at("note-text").get_property("value") == "half a no"


def test_replay_seeks_forwards_and_back(open_page: Callable[..., Page]) -> None:
    """By the bar's keys and by its buttons; what was told later is not there earlier."""
    page = open_page(Swarm("replay"))
    page.until(lambda: page.at("replay").is_displayed() and len(page.texts("#inbox-list > li")) == 50)
    page.at("seek-on").click()
    assert page.asked("seek") == {"type": "seek", "time_s": 110}
    page.until(lambda: page.text("time") == "1:50")
    page.at("seek").send_keys(Keys.ARROW_LEFT)
    page.until(lambda: page.text("time") == "1:49")
    page.at("seek").send_keys(Keys.HOME)
    page.until(lambda: page.text("time") == "0:00")
    page.until(lambda: not page.texts("#inbox-list > li"))
    page.at("seek").send_keys(Keys.END)
    page.until(lambda: page.text("time") == "10:00")
    page.until(lambda: page.text("inbox-count") == "300 unread")
    assert not page.at("command-form").is_displayed()


def test_a_replay_shows_on_its_time_bar_what_the_participant_did(open_page: Callable[..., Page]) -> None:
    """Judgements, answers, selections and notes; the list leads to each, and the map rings what was selected."""
    page = open_page(Swarm("replay"))
    acts = [
        {"time_s": 60.0, "kind": "page", "name": "selected", "text": "event 2"},
        {"time_s": 70.0, "kind": "judge", "name": "decoy", "event": 2},
        {"time_s": 300.0, "kind": "answer", "name": "sagat", "text": "trees: 2"},
        {"time_s": 450.0, "kind": "note", "text": "too fast"},
    ]
    page.feed.send({"type": "acts", "acts": acts, "is_first": True})
    page.until(lambda: page.at("marks").is_displayed())
    rows = page.texts("#marks > span")
    assert rows == ["judgements: 1", "answers: 1", "selections: 1", "notes and other acts: 1"]
    assert page.all("#marks i")[0].get_attribute("title") == "1:10 decoy event 2"
    page.at("tab-acts").click()
    page.until(lambda: len(page.all("#acts-list li")) == 3)
    before = page.drawn()
    page.all("#acts-list button")[1].click()
    assert page.asked("seek") == {"type": "seek", "time_s": 300}
    page.until(lambda: page.text("time") == "5:00" and page.drawn() != before)


CHART = "#workload-chart canvas"
SEEK = "const bar = document.getElementById('seek'); bar.value = arguments[0]; bar.dispatchEvent(new Event('change'))"


def test_a_replay_that_jumps_back_has_its_chart_and_its_read_marks(open_page: Callable[..., Page]) -> None:
    """As they were at that time: an item that was read later is unread again."""
    page = open_page(Swarm("replay", read={3}))
    page.until(lambda: len(page.texts("#inbox-list > li")) == 50)
    page.until(lambda: page.all('#inbox-list [data-key="3"][data-read="true"]'))
    page.player.swarm.read.add(4)
    page.feed.send({"type": "read", "items": [4]})
    page.until(lambda: page.all('#inbox-list [data-key="4"][data-read="true"]'))
    page.driver.execute_script(SEEK, 600)
    page.until(lambda: "until 10:00" in page.at("workload-chart").get_attribute("aria-label"))
    chart = page.drawn(CHART)
    page.player.swarm.read.remove(4)
    page.driver.execute_script(SEEK, 100)
    page.until(lambda: "until 1:40" in page.at("workload-chart").get_attribute("aria-label"))
    assert page.drawn(CHART) != chart
    page.until(lambda: page.all('#inbox-list [data-key="4"][data-read="false"]'))
    assert page.all('#inbox-list [data-key="3"][data-read="true"]')


def test_the_researchers_view_says_so(open_page: Callable[..., Page]) -> None:
    page = open_page(Swarm("researcher", silent=()))
    page.until(lambda: page.at("role").is_displayed())
    assert page.text("role") == "Researcher's view: shows what no operator knows"
    page.until(lambda: page.all('#agents-list [data-agent="9"]'))
    assert not page.at("command-form").is_displayed()
    assert not page.at("tab-notes").is_displayed()
    assert not page.at("layer-heat").is_selected()
    page.until(lambda: "event 1at (20, 25) m, since 0:00" in page.texts("#events-list > li"))


@pytest.mark.slow
def test_dark_and_light(page: Page) -> None:
    """As the machine has it; the page's own switch wins, and stays."""
    colour = "return getComputedStyle(document.body).backgroundColor"
    light = page.driver.execute_script(colour)
    page.driver.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    )
    page.until(lambda: page.driver.execute_script(colour) != light)
    page.until(lambda: page.text("theme") == "Light")
    page.at("theme").click()
    page.until(lambda: page.driver.execute_script(colour) == light)
    page.driver.refresh()
    page.until(lambda: page.text("theme") == "Dark")
    assert page.driver.execute_script(colour) == light
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_every_panel_fits_on_the_screens_it_is_made_for(page: Page) -> None:
    """Nothing runs out of the window, and the map stays the largest."""
    for width, height in ((1366, 768), (1920, 1080), (1024, 768)):
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        page.until(lambda width=width: page.driver.execute_script("return innerWidth") == width)
        boxes = [section.rect for section in page.all("main > section:not(.asks)")]
        assert all(box["x"] + box["width"] <= width and box["y"] + box["height"] <= height for box in boxes)
        assert all(box["width"] >= 300 and box["height"] >= 200 for box in boxes)
        assert page.at("map").size["height"] >= 280
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_the_map_stays_as_it_was_moved(page: Page) -> None:
    """The run's description comes again each second; only that of another run shows all of its arena."""
    whole = page.drawn()
    page.at("map-in").click()
    near = page.drawn()
    page.feed.send(page.player.swarm.hello(title="once more"))
    page.until(lambda: page.text("title") == "once more")
    assert page.drawn() == near != whole


def test_the_end_of_the_run_is_told(page: Page) -> None:
    page.feed.hang_up()
    page.until(lambda: page.text("status").startswith("the run has ended"))
    assert page.feed.process.wait(PATIENCE_S) == 0
    assert page.text("time") == "1:40"
    page.at("pause").click()
    page.until(lambda: page.text("said") == "Not sent: the run has ended.")
