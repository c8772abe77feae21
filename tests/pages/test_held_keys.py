"""Keys that are held, and links that are slow: each press counts once, and only for what was on the screen."""

from collections.abc import Callable

import pytest

from tests.pages.test_station_study import a_form, hello
from tests.support.station_feed import ISA
from tests.support.station_page import NEEDS_BROWSER, Page

pytestmark = NEEDS_BROWSER

PAINTED = "requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(arguments[0])))"


class Keyboard:
    """A key as the operating system sends it: it goes down, repeats while it is held, and comes up."""

    def __init__(self, page: Page, key: str, code: str, number: int) -> None:
        self.page = page
        self.told = {"key": key, "code": code, "windowsVirtualKeyCode": number}
        self.text = {} if len(key) > 1 else {"text": key}

    def send(self, kind: str, **more: object) -> None:
        self.page.driver.execute_cdp_cmd("Input.dispatchKeyEvent", {"type": kind, **self.told, **more})

    def hold(self, times: int = 0) -> None:
        self.send("keyDown", **self.text)
        self.repeat(times)

    def repeat(self, times: int = 20) -> None:
        for _ in range(times):
            self.send("keyDown", autoRepeat=True, **self.text)

    def release(self) -> None:
        self.send("keyUp")


def sent(page: Page, kind: str) -> int:
    """How many inputs of a kind came, once the page has answered a note that was made after them."""
    page.press("n")
    page.press("the end")
    page.at("note-send").click()
    page.asked("note")
    return sum(intent["type"] == kind for intent in page.player.intents)


@pytest.mark.parametrize(("key", "code", "number", "kind"), [("x", "KeyX", 88, "judge"), ("p", "KeyP", 80, "pace")])
def test_a_key_that_is_held_acts_once(page: Page, key: str, code: str, number: int, kind: str) -> None:
    hello(page, goal="Find the targets.")
    page.until(lambda: page.at("judge").is_displayed())
    held = Keyboard(page, key, code, number)
    held.hold(times=50)
    held.release()
    assert sent(page, kind) == 1


def test_a_button_that_has_the_focus_is_pressed_once(page: Page) -> None:
    """Browsers press a button again for each repeat of Enter."""
    hello(page, goal="Find the targets.")
    page.until(lambda: page.at("judge").is_displayed())
    page.driver.execute_script("document.getElementById('judge-decoy').focus()")
    enter = Keyboard(page, "Enter", "Enter", 13)
    enter.text = {"text": "\r"}
    enter.hold(times=30)
    enter.release()
    assert sent(page, "judge") == 1


def test_a_key_that_was_down_before_the_question_does_not_answer_it(page: Page) -> None:
    """It must come up first; then it answers."""
    three = Keyboard(page, "3", "Digit3", 51)
    three.hold()
    page.ask(ISA)
    page.driver.execute_async_script(PAINTED)
    three.repeat()
    three.release()
    assert page.at("isa").is_displayed()
    assert not any(intent["type"] == "isa" for intent in page.player.intents)
    three.hold(times=5)
    three.release()
    assert page.asked("isa") == {"type": "isa", "number": 3, "answer": 3}


def test_a_key_that_is_held_over_a_prompt_does_not_answer_the_question_after_it(page: Page) -> None:
    """Enter says to be ready; the question then has the focus, and the same press must not send it."""
    form = {**a_form(0)["form"], "title": "Are you ready?", "question": []}
    page.ask({**a_form(0), "hides": False, "left_s": 20.0, "prompt": True, "form": form})
    page.press("q")
    enter = Keyboard(page, "Enter", "Enter", 13)
    enter.text = {"text": "\r"}
    enter.hold(times=3)
    page.player.heard(lambda intent: intent["type"] == "ready")
    optional = {**a_form(0)["form"]["question"][0], "required": False}
    page.player.swarm.probe = {
        **a_form(0),
        "hides": False,
        "left_s": 20.0,
        "form": {**a_form(0)["form"], "question": [optional]},
    }
    page.player.show(102.0)
    page.until(lambda: page.texts("#form-questions input"))
    enter.repeat()
    enter.release()
    assert not any(intent["type"] == "form" for intent in page.player.intents)


def test_what_is_typed_keeps_its_repeats(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.press("n")
    held = Keyboard(page, "a", "KeyA", 65)
    held.hold(times=4)
    held.release()
    page.until(lambda: page.at("note-text").get_property("value") == "aaaaa")
