"""Nothing is lost that was called noted: a real page over a link that swallows everything and comes back."""

import csv
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest
from selenium.webdriver.common.keys import Keys

from tests.support.at_the_console import AtTheConsole
from tests.support.cable import Cable, cable
from tests.support.commanding import briefing
from tests.support.station_feed import Feed
from tests.support.station_page import NEEDS_BROWSER, Looking

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

pytestmark = NEEDS_BROWSER

FORM = {"name": "trust", "when": "after", "question": [{"name": "why", "text": "Why?", "kind": "text"}]}
PROBES = {"isa_every_s": 1.0, "isa_wait_s": 30.0, "tlx": True, "form": [FORM]}
OPERATOR = {"probes": PROBES, "task": {"target_share": 0.5}}


class Station:
    """A console, its page in a browser, and the link between them."""

    def __init__(self, driver: "Chrome", feed: Feed, link: Cable, folder: Path) -> None:
        self.folder = folder
        self.link = link
        self.operator = AtTheConsole(feed, briefing(operator=OPERATOR), folder)
        self.page = Looking(driver)
        self.operator.close_step()
        driver.get(feed.url.replace(f":{urlsplit(feed.url).port}/", f":{link.port}/"))
        self.page.until(lambda: self.page.text("status") == "live")

    def until_lost(self) -> None:
        self.page.until(lambda: "connection lost" in self.page.text("status"))

    def rows(self, name: str) -> list[dict[str, str]]:
        """A table, once the run is over."""
        with (self.folder / f"{name}.csv").open(newline="") as stream:
            return list(csv.DictReader(stream))


@pytest.fixture
def station(driver: "Chrome", tmp_path: Path) -> Iterator[Station]:
    """One whose page is at the near end of the link."""
    with Feed() as feed, cable(urlsplit(feed.url).port or 0) as link:
        yield Station(driver, feed, link, tmp_path)
        driver.get("about:blank")


def test_what_is_done_while_the_link_is_dead_is_noted_once_it_is_back(station: Station) -> None:
    """Every kind of input, each once, after a reload too; until then the page keeps it, and says so."""
    page, operator = station.page, station.operator
    operator.close_step()
    page.until(lambda: page.at("isa").is_displayed())
    station.link.die()
    page.at("isa").find_element("css selector", "[data-answer='4']").click()
    page.press("p")
    page.at("tab-events").click()
    page.all("#events-list button")[0].click()
    page.press("x")
    page.press("n")
    page.at("note-text").send_keys("odd", Keys.CONTROL, Keys.ENTER)
    page.press(Keys.ESCAPE, "c")
    page.at("command-send").click()
    page.press(Keys.ESCAPE, "u")
    page.until(lambda: page.text("kept") == "Not noted yet: 6. It stays here, and is sent again by itself.")
    assert page.at("isa").is_displayed()
    assert page.at("note-text").get_property("value") == "odd"
    assert "noted" not in page.text("said")
    station.until_lost()
    station.link.mend()
    page.until(lambda: not page.at("isa").is_displayed() and page.at("note-text").get_property("value") == "")
    page.until(lambda: not page.at("kept").is_displayed())
    operator.close_step(last=True)
    page.until(lambda: page.at("tlx").is_displayed())
    for scale in page.all("#tlx input[type=range]"):
        scale.send_keys(Keys.END)
    station.link.die(down=False)  # pictures still come
    page.at("tlx-send").click()
    page.until(lambda: page.text("tlx-missing").startswith("Not noted yet"))
    station.until_lost()
    station.link.mend()
    page.until(lambda: page.at("form").is_displayed() and page.text("form-title") == "trust")
    page.at("question-0").send_keys("a guess")
    page.at("form-send").click()
    page.until(lambda: not page.at("form").is_displayed())
    operator.finish()
    acts = [act for act in station.rows("actions") if act["kind"] != "page"]
    assert Counter(act["kind"] for act in acts) == Counter(
        ["isa", "pace", "judge", "note", "command", "read", "tlx", "form"]
    )
    assert all(float(act["delay_s"]) > 1.0 for act in acts if act["kind"] != "form")
    assert len({act["input"] for act in acts}) == len(acts)
    probes: list[Any] = [(row["probe"], row["value"]) for row in station.rows("probes")]
    assert probes == [("isa", "4"), *[("tlx", "100")] * 6, ("trust", "a guess")]
    noted = [(act["name"], act["text"]) for act in station.rows("actions") if act["kind"] == "page"]
    assert {"away", "back"} <= {name for name, _ in noted}  # a slow machine may add absences
    assert ("selected", "event 1") in noted


@pytest.mark.slow
def test_what_was_not_noted_before_a_reload_is_noted_after_it(station: Station) -> None:
    """And what is sent over a link that passes nothing back arrives twice, and counts once."""
    page, operator = station.page, station.operator
    station.link.die()
    page.press("n")
    page.at("note-text").send_keys("before", Keys.CONTROL, Keys.ENTER)
    page.until(lambda: page.at("kept").is_displayed())
    stored = page.driver.execute_script("return sessionStorage.getItem('deltaswarm-outbox')")
    assert [one["intent"]["text"] for one in json.loads(stored) if one["intent"]["type"] == "note"] == ["before"]
    station.link.mend()
    page.driver.refresh()
    page.until(lambda: page.text("status") == "live")
    page.until(lambda: page.at("note-text").get_property("value") == "")
    operator.finish()
    assert [act["text"] for act in station.rows("actions") if act["kind"] == "note"] == ["before"]


@pytest.mark.slow
def test_answers_over_a_slow_link_count_by_the_time_of_the_page(driver: "Chrome", tmp_path: Path) -> None:
    """Two seconds each way: answered late in its time, at the end of the run, and judged before the page knew of it."""
    probes = {"isa_every_s": 1.0, "isa_wait_s": 8.0}
    with Feed() as feed, cable(urlsplit(feed.url).port or 0) as link:
        operator = AtTheConsole(feed, briefing(operator={"probes": probes, "task": {"target_share": 0.5}}), tmp_path)
        operator.close_step()
        page = Looking(driver)
        link.delay_s = 2.0
        driver.get(feed.url.replace(f":{urlsplit(feed.url).port}/", f":{link.port}/"))
        page.until(lambda: page.text("status") == "live")
        page.until(lambda: operator.console.beats.rtt_s > 3.5)
        for is_last in (False, True):
            operator.close_step()
            page.until(lambda: page.at("isa").is_displayed())
            if not is_last:
                page.until(lambda: page.text("isa-seconds") in ("2 s left", "1 s left"))
            else:
                page.at("tab-events").click()
                page.all("#events-list button")[0].click()
                operator.close_step(last=True)  # the page does not know yet
                page.press("x")
            page.press("3")
            page.until(lambda: not page.at("isa").is_displayed())
            assert not page.at("kept").is_displayed()
        page.until(lambda: not operator.is_asking)
        operator.finish()
        driver.get("about:blank")
    with (tmp_path / "probes.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["value"], row["outcome"]) for row in rows] == [("3", "answered")] * 2
    assert float(rows[0]["latency_s"]) > 8.0 > float(rows[0]["reaction_s"])
    with (tmp_path / "actions.csv").open(newline="") as stream:
        kinds = [row["kind"] for row in csv.DictReader(stream)]
    assert kinds.count("judge") == 1
    assert list(operator.console.judgements.values()) == ["target"]
