"""Orders at the station's page in a real browser: by mouse, by key and by the map, and what became of them."""

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select

from tests.support.station_feed import FORMS, ISA
from tests.support.station_page import NEEDS_BROWSER, Page

pytestmark = NEEDS_BROWSER


def test_a_command_by_mouse(page: Page) -> None:
    Select(page.at("command-name")).select_by_value("set delta")
    page.all('input[name="target"][value="circle"]')[0].click()
    page.click_map(30, 70)
    delta = page.all('[data-argument="delta"]')[0]
    delta.clear()
    delta.send_keys("2")
    page.at("command-send").click()
    command = page.asked("command")
    target = command["target"]
    assert (command["name"], command["arguments"]) == ("set delta", {"delta": 2})
    assert (target["kind"], target["radius_m"]) == ("circle", 10)
    assert (target["x_m"], target["y_m"]) == (pytest.approx(30, abs=0.4), pytest.approx(70, abs=0.4))
    page.until(lambda: page.text("command-answer") == "Sent as order 1.")
    page.until(lambda: "heard by nobody yet" in page.text("fates"))
    page.player.swarm.commands[0][5:] = [4, 3, 1, 160.0, "done", 2, [7], "person"]
    page.player.show(102.0)
    page.until(lambda: "heard by 4, refused by agent 7, replaced at 2;" in page.text("fates"))
    assert page.text("fates").endswith("done by 3")


def test_an_order_is_on_the_map_until_it_expires(page: Page) -> None:

    def show(expires_s: float) -> None:
        order = [0, "hold", ["circle", 30, 70, 9], {}, 90.0, 0, 0, 0, expires_s, "sent", 0, [], "person"]
        page.player.show(100.0, commands=[order])

    show(200.0)
    page.until(lambda: page.text("fates").startswith("0 · hold"))
    with_order = page.drawn()
    show(95.0)
    page.until(lambda: page.drawn() != with_order)


def test_a_change_by_the_system_is_told_and_vetoed_by_key(page: Page) -> None:
    order = [0, "set delta", ["all"], {"delta": 2}, 90.0, 0, 0, 0, 200.0, "sent", 0, [], "system"]
    page.player.show(100.0, proposal={"delta": 3, "left_s": 7.2}, commands=[order])
    page.until(lambda: page.at("proposal").is_displayed() and page.text("proposal-left") == "in 8 s")
    assert "delta to 3" in page.text("proposal-text")
    page.until(lambda: "by the system" in page.text("fates"))
    page.press("v")
    assert page.asked("veto")
    page.player.show(101.0, proposal=None)
    page.until(lambda: not page.at("proposal").is_displayed())


def test_a_tree_is_chosen_by_any_of_its_agents_on_the_map(page: Page) -> None:
    Select(page.at("command-name")).select_by_value("recall a tree")
    row = next(row for row in page.player.swarm.agent_rows(100.0) if row[0] == 1)
    page.until(lambda: page.text("agents-list"))
    page.click_map(row[1], row[2])
    page.until(lambda: page.text("map-info").startswith("Agent 1: in the tree of agent 0"))
    page.at("command-send").click()
    assert page.asked("command") == {
        "type": "command",
        "name": "recall a tree",
        "target": {"kind": "tree", "root": 0},
        "arguments": {},
    }


def test_a_command_by_keyboard(page: Page) -> None:
    """Without a pointer, from the first key to the last; and a mistake is told in words."""
    page.press("c")
    page.press("attend", Keys.TAB)
    page.press(Keys.TAB, "40.5", Keys.TAB, "12", Keys.TAB, Keys.DELETE, "0")
    page.press(Keys.ENTER)
    page.until(lambda: page.text("command-answer") == "Not sent: for must be at least 1 (got 0).")
    page.press(Keys.BACKSPACE, "30", Keys.ENTER)
    assert page.asked("command") == {
        "type": "command",
        "name": "attend a place",
        "target": {"kind": "place", "x_m": 40.5, "y_m": 12},
        "arguments": {"for": 30, "pace": "fast"},
    }
    page.until(lambda: page.text("command-answer") == "Sent as order 1.")


def test_an_event_is_the_place_of_an_order(page: Page) -> None:
    """Choose an order, then an event in the list; Control and Enter send from any field."""
    Select(page.at("command-name")).select_by_value("attend a place")
    page.until(lambda: page.all("#events-list > li"))
    page.at("tab-events").click()
    page.all('#events-list [data-event="2"] button')[0].click()
    page.press("c")
    page.until(lambda: page.at("command-name").is_displayed())
    ActionChains(page.driver).key_down(Keys.CONTROL).send_keys(Keys.ENTER).key_up(Keys.CONTROL).perform()
    target = page.asked("command")["target"]
    _, x_m, y_m, *_ = page.player.swarm.event_rows(100.0)[2]
    assert target == {"kind": "place", "x_m": x_m, "y_m": y_m}


def test_shortcuts_work_in_a_list_of_options(page: Page) -> None:
    """A letter that begins an option chooses it, and so do digits right after it; Escape leaves a field."""
    page.ask(ISA)
    page.press("c", "h")
    assert page.at("command-name").get_property("value") == "hold"
    page.press("4")
    page.press(Keys.ESCAPE, "4")
    assert page.asked("isa") == {"type": "isa", "number": 3, "answer": 4}
    page.press(Keys.ESCAPE, "n", "p")
    assert page.at("note-text").get_property("value") == "p"
    page.press(Keys.ESCAPE, "p")
    assert page.asked("pace") == {"type": "pace", "paused": True}


@pytest.mark.slow
def test_a_place_outside_the_arena_is_not_sent(page: Page) -> None:
    Select(page.at("command-name")).select_by_value("attend a place")
    page.at("command-x").send_keys("505")
    page.at("command-y").send_keys("50")
    page.at("command-send").click()
    page.until(lambda: "505" in page.text("command-answer"))
    assert not any(intent["type"] == "command" for intent in page.player.intents)


def test_an_order_that_nobody_carries_out_cannot_be_chosen(page: Page) -> None:
    """It is in the list with the reason, and the first of the others is chosen."""
    forms = [{**form, "refused": form["name"] == "set delta"} for form in FORMS]
    page.feed.send(page.player.swarm.hello(commands=forms))
    page.until(lambda: page.at("command-name").get_property("value") == "recall a tree")
    options = Select(page.at("command-name")).options
    assert [option.is_enabled() for option in options] == [False, True, True, True]
    assert "nobody carries it out" in options[0].text


def test_an_order_that_is_refused_says_why(page: Page) -> None:
    page.player.swarm.answer = lambda intent, _: [  # type: ignore[method-assign]
        {"type": "refused", "to": intent["from"], "id": intent.get("id"), "why": "no uplink"}
    ]
    page.at("command-send").click()
    page.until(lambda: page.text("command-answer") == "Not sent: no uplink.")
