"""A person reads the inbox under each policy: times of what was shown and read are those of the driver's log."""

import csv
import json
import time
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.support.select import Select

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import page_hello
from deltaswarm_operator.core.intents import carry_out
from deltaswarm_operator.io.action_log import ActionLog
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from deltaswarm_wire.plugins import INBOX_POLICIES
from tests.support.commanding import briefing
from tests.support.station_feed import Feed
from tests.support.station_page import NEEDS_BROWSER, Looking
from tests.support.tiers import first_of

pytestmark = NEEDS_BROWSER

AGENTS = 10


class Served(Looking):
    """A page of a real console, whose steps the test closes."""

    def __init__(self, driver: webdriver.Chrome, feed: Feed, console: Console) -> None:
        super().__init__(driver)
        self.feed, self.console, self.step = feed, console, -1
        driver.get(feed.url)

    def serve(self) -> None:
        """Send what the operator's process would, and carry out what the page sent."""
        self.feed.send(page_hello(self.console, "run"), self.console.show(time.monotonic()))
        try:
            while True:
                intent = self.feed.hear_any(0.05)
                self.feed.send(*carry_out(self.console, json.dumps(intent).encode(), time.monotonic()))
        except TimeoutError:
            pass

    def close(self, *reports: Report) -> None:
        self.step += 1
        workload = Workload(self.step, float(self.step), len(reports), 0, 0.0, 0.0, 0.0, 0, 0, 0)
        self.console.close_step(Clock(self.step, float(self.step), False), workload, reports, time.monotonic())

    def served(self, holds: Any) -> Any:
        """Wait, while the operator's process goes on."""
        return self.until(lambda: (self.serve(), holds())[1])

    @property
    def lines(self) -> list[str]:
        rows = "return [...document.querySelectorAll('#inbox-list > li')].map((row) => row.dataset.key)"
        return list(self.driver.execute_script(rows))  # type: ignore[no-untyped-call]


def reports(step: int) -> list[Report]:
    """Ten messages per second: most repeat what is known; each tenth second has a new event."""
    events = tuple(Event(100 + number, float(number), 1.0) for number in range(step // 10 + 1))
    return [Report(agent, step, step, "attending", 1.0, 1.0, 0, events[-3:]) for agent in range(AGENTS)]


LISTED = {"all": 150, "ranked": 150, "new": 4, "grouped": 4, "limited": 6, "digest": 3}
"""Lines on the page after 31 s; of 310 it lists 150."""


@pytest.mark.parametrize("policy", first_of(["grouped", *(INBOX_POLICIES.shipped.keys() - {"grouped"})]))
def test_a_person_reads_under_a_policy(driver: webdriver.Chrome, policy: str, tmp_path: Path) -> None:
    """Reads a line, then all, then what is held back; times are those of the driver's log."""
    every = {"every_s": 10.0} if policy == "digest" else {}
    operator = {"inbox": {"policy": policy, "repeats": True, **every}}
    console = Console(briefing(operator=operator))
    console.attend()
    with Feed() as feed:
        page = Served(driver, feed, console)
        log: dict[int, float] = {}
        for step in range(31):
            page.close(*reports(step))
        page.served(lambda: len(page.lines) == LISTED[policy])
        unread = console.ledger.unread
        assert page.text("inbox-count") == f"{unread} unread"
        page.press("u")
        page.served(lambda: console.ledger.read_s)
        log |= dict.fromkeys(console.ledger.read_s, 30.0)
        page.served(lambda: page.text("inbox-count") == (f"{unread - 1} unread" if unread > 1 else "all read"))
        page.close()
        page.at("inbox-all-read").click()
        page.served(lambda: page.text("inbox-count") == "all read")
        log |= dict.fromkeys(console.ledger.read_s.keys() - log.keys(), 31.0)
        held = console.ledger.held.items
        Select(page.at("inbox-filter")).select_by_value("held")
        page.served(lambda: len(page.lines) == min(held, 150))
        if held:
            page.close()
            [first, *_] = page.lines
            page.all("#inbox-list > li")[0].click()
            page.served(lambda: console.ledger.opened)
            log[int(first)] = 32.0
        kept = "return sessionStorage.getItem('deltaswarm-outbox')"
        page.served(lambda: driver.execute_script(kept) == "[]")  # type: ignore[no-untyped-call]
        assert driver.get_log("browser") == []  # type: ignore[no-untyped-call]
    ActionLog(tmp_path).close(console)
    with (tmp_path / "inbox.csv").open(newline="") as table:
        rows = {int(row["item"]): row for row in csv.DictReader(table)}
    assert len(rows) == 310
    assert {number: float(row["read_s"]) for number, row in rows.items() if row["read_s"]} == log
    assert all(float(row["shown_s"]) <= log[number] for number, row in rows.items() if number in log)
    assert sum(row["is_opened"] == "1" for row in rows.values()) == bool(held)
    assert all(row["held_because"] for row in rows.values() if not row["shown_s"])
