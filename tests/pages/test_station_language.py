"""The station's page in another language: everything that is read is translated, and nothing that is stored."""

import re
from collections.abc import Callable, Iterable
from importlib import resources
from typing import Any

import pytest
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select

from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.page_language import TEXTS, page_texts
from deltaswarm_scenario.task import GOAL
from deltaswarm_sessions import session
from tests.support.page_texts import texts
from tests.support.station_feed import CONSENT, FORMS, TLX, Message, Swarm
from tests.support.station_page import NEEDS_BROWSER, Page

pytestmark = NEEDS_BROWSER

FORM: Message = {
    "name": "ours",
    "title": "Our questions",
    "text": "Please answer.",
    "question": [
        {"name": "sure", "text": "How sure are you?", "kind": "likert", "low_text": "not at all", "high_text": "fully"},
        {"name": "where", "text": "Where?", "kind": "choice", "choices": ["left", "right"]},
        {"name": "why", "text": "Why?", "kind": "text", "required": False},
    ],
}
DEFAULTS = {"low": 1, "high": 7, "low_text": "", "high_text": "", "choices": [], "required": True}
SESSION = {
    "sheet": {"consent": CONSENT, "participant": "P07", "condition": "2"},
}
SET_SCALES = "for (const e of document.querySelectorAll('#tlx [type=range]')) e.dispatchEvent(new Event('input'));"
DATA = {"P07", "NASA", "TLX", "min"}
"""Words that are no texts: a participant's code, an instrument's name, a unit."""

READ = r"""
const isShown = (e) => e.checkVisibility() || (e.localName === "option" && e.parentElement.checkVisibility());
const read = [];
for (const e of document.body.querySelectorAll("*")) {
    if (!isShown(e)) continue;
    for (const node of e.childNodes) if (node.nodeType === Node.TEXT_NODE) read.push(node.nodeValue);
    for (const name of ["title", "aria-label", "placeholder"]) read.push(e.getAttribute(name) ?? "");
    for (const part of ["::before", "::after"]) {
        const content = getComputedStyle(e, part).content;
        read.push(content === "none" || content === "normal" ? "" : content);
    }
}
return read.concat(document.title);
"""


def strings(value: Any) -> Iterable[str]:
    """All texts in a message of forms; keys and codes do no harm."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from strings(part)


def bracketed(text: str) -> str:
    """A text in a language that only has brackets, around everything but what is put in."""
    parts = re.split(r"(\{\w+\})", text)
    return "".join(part if at % 2 or not part.strip() else f"[[{part}]]" for at, part in enumerate(parts))


OURS = {*strings(FORMS), *strings(FORM), CONSENT}
PSEUDO: Message = {"tag": "x-pseudo", "texts": {text: bracketed(text) for text in (*page_texts(), *OURS)}}


def untranslated(page: Page) -> list[str]:
    """What a person sees or hears, and has words outside of brackets."""
    found = []
    for text in page.driver.execute_script(READ):
        rest = re.sub(r"\[\[.*?\]\]", " ", text, flags=re.DOTALL)
        if {*re.findall(r"[A-Za-z]{2,}\d*", rest)} - DATA:
            found.append(text)
    return found


def asks(page: Page, shown: str, **probe: Any) -> None:
    page.player.swarm.probe = probe
    page.player.show()
    page.until(lambda: page.at(shown).is_displayed())


def asks_form(page: Page, **changes: Any) -> None:
    form = {**FORM, "question": [DEFAULTS | question for question in FORM["question"]]}
    asks(page, "form", **{"kind": "form", "number": 0, "hides": False, "left_s": None, "form": form} | changes)


@pytest.fixture
def pseudo(open_page: Callable[..., Page]) -> Callable[..., Page]:
    """Opens the page in the language of brackets."""

    def opened(kind: str = "live") -> Page:
        page = open_page(Swarm(kind, language=PSEUDO))
        page.feed.send(page.player.swarm.hello(title="1", session=SESSION))
        page.player.show()
        page.until(lambda: page.text("title") == "1" and page.text("inbox-list"))
        return page

    return opened


def test_the_catalogue_has_the_pages_texts() -> None:
    """`python -m tests.support.page_texts > agent/deltaswarm_scenario/page_texts.json` writes it anew."""
    assert list(page_texts()) == texts(), resources.files("deltaswarm_scenario") / TEXTS


def test_everything_on_the_live_page_is_translated(pseudo: Callable[..., Page]) -> None:
    """Each tab, the orders and what becomes of them, what is selected, the help, errors, the end."""
    page = pseudo()
    assert page.driver.execute_script("return document.documentElement.lang") == "x-pseudo"
    for tab in ("agents", "events", "notes", "commands"):
        page.at(f"tab-{tab}").click()
        page.until(lambda: untranslated(page) == [])
    for form in FORMS:
        Select(page.at("command-name")).select_by_value(form["name"])
        for radio in page.all("#command-targets input"):
            radio.click()
            # Again if it comes too soon after the last: the page takes that for a double click.
            page.until(lambda: page.at("command-send").click() or page.text("command-answer"))
            assert untranslated(page) == []
    rows = [
        [number, "set delta", ["all"], {"delta": 4}, 90.0, heard, done, refused, 160.0, state, late, refusers, by]
        for number, (heard, done, refused, state, late, refusers, by) in enumerate(
            [
                (3, 1, 2, "done", 1, [4, 5], "system"),
                (3, 0, 9, "heard", 0, [4], "person"),
                (0, 0, 0, "expired", 0, [], "person"),
            ]
        )
    ]
    page.player.swarm.commands[:0] = rows
    page.feed.send(page.player.swarm.hello(title="1", session=SESSION, goal=GOAL))
    page.player.show(proposal={"delta": 2, "left_s": 9.0}, probe=None, judged=[[0, "target"]])
    page.until(lambda: page.at("proposal").is_displayed() and len(page.texts("#fates li")) >= 3)
    for key in ("u", "y", "?"):
        page.press(key)
        assert untranslated(page) == []
    page.at("help-close").click()
    for why, told in (
        ("this question is no longer open", "[[this question is no longer open]]"),
        ("the radius must be above 0 m (got -2)", "[[the radius must be above 0 m (got ]]-2[[)]]"),
    ):
        page.feed.send({"type": "refused", "id": None, "why": why})
        page.until(lambda told=told: page.text("said") == f"[[Not accepted: ]]{told}[[.]]")
    page.player.swarm.over = True
    page.player.show()
    page.until(lambda: "over" in page.text("status"))
    assert untranslated(page) == []


def test_every_question_is_translated(pseudo: Callable[..., Page]) -> None:
    """The session's sheet, ISA, NASA-TLX, a form, a question in passing; with their complaints."""
    page = pseudo()
    asks(page, "sheet", kind="sheet")
    assert untranslated(page) == []
    asks(page, "isa", kind="isa", number=3, asked_s=90.0, left_s=21.0)
    assert untranslated(page) == []
    asks(page, "tlx", **TLX)
    assert untranslated(page) == []
    page.driver.execute_script(SET_SCALES)
    page.at("tlx-send").click()
    assert untranslated(page) == []
    asks_form(page)
    page.at("form-send").click()
    page.until(lambda: page.text("form-missing"))
    assert untranslated(page) == []
    told = session.SCORE_TEXT.format(right=4, events=9, hits=3, misses=2, false_alarms=2, unjudged=1, chance=4)
    asks_form(page, number=2, form={"name": "score", "title": "Your score", "text": told, "question": []})
    page.until(lambda: "score" in page.text("form-title"))
    assert untranslated(page) == []
    situation = {"name": "spam", "title": "What is the situation?", "text": ""}
    quarter = {"name": "most_events", "kind": "choice", "choices": ["top left", "bottom right"]}
    quarter["text"] = "Which quarter of the area has the most open events now?"
    asks_form(page, number=1, left_s=20.0, form={**situation, "question": [DEFAULTS | quarter]})
    page.until(lambda: "top left" in page.text("form-questions"))
    assert untranslated(page) == []


def test_a_replay_is_translated(pseudo: Callable[..., Page]) -> None:
    page = pseudo("replay")
    page.until(lambda: page.at("replay").is_displayed() and "replay" in page.text("status"))
    page.until(lambda: untranslated(page) == [])


def test_another_language_loads_the_page_again(page: Page) -> None:
    assert len(untranslated(page)) > 100
    page.player.swarm.language = PSEUDO
    page.feed.send(page.player.swarm.hello())
    page.until(lambda: page.text("inbox-all-read") == "[[Mark all read]]")


def work(page: Page) -> list[Message]:
    """Do what a participant does, and return what the page sent of it."""
    sent = []
    page.feed.send(page.player.swarm.hello(session=SESSION))
    asks(page, "sheet", kind="sheet")
    page.at("sheet-agree").click()
    page.at("sheet-begin").click()
    sent.append(page.asked("sheet"))
    page.until(lambda: not page.at("sheet").is_displayed())
    asks(page, "isa", kind="isa", number=3, asked_s=90.0, left_s=21.0)
    page.all('#isa [data-answer="4"]')[0].click()
    sent.append(page.asked("isa"))
    page.until(lambda: not page.at("isa").is_displayed())
    Select(page.at("command-name")).select_by_value("attend a place")
    page.at("command-x").send_keys("5")
    page.at("command-y").send_keys("6")
    Select(page.at("argument-1")).select_by_value("slow")
    page.at("command-send").click()
    sent.append(page.asked("command"))
    page.at("tab-notes").click()
    page.at("note-text").send_keys("so", Keys.CONTROL, Keys.ENTER)
    sent.append(page.asked("note"))
    page.at("tab-agents").click()
    page.all("#agents-list button")[2].click()
    for text in ("tab-commands", "tab-notes", "tab-agents", "agent 2"):
        page.player.heard(lambda intent, text=text: intent["type"] == "page" and intent.get("text") == text)
    asks_form(page)
    for selector in ('[value="6"]', '[value="right"]'):
        page.all(f"#form-questions {selector}")[0].click()
    page.at("form-send").click()
    sent.append(page.asked("form"))
    asks(page, "tlx", **TLX)
    page.driver.execute_script(SET_SCALES)
    page.at("tlx-send").click()
    page.driver.execute_script(
        "for (const e of document.querySelectorAll('#tlx-pairs fieldset')) e.querySelector('input').click();"
    )
    page.at("tlx-send").click()
    return [*sent, page.asked("tlx")]


@pytest.mark.slow
def test_what_is_stored_is_the_same_in_every_language(open_page: Callable[..., Page]) -> None:
    """Answers, orders and what happens to the page, in English and in German."""
    german = load_scenario("smoke", ["operator.page.language=de"]).operator.page.language.told
    english = work(open_page(Swarm()))
    page = open_page(Swarm(language=german))
    assert work(page) == english
    assert page.text("tlx-title") == "Wie war die Aufgabe?"
    assert page.text("tab-notes").strip() == "Notizen"
