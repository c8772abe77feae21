"""A driver that only reads the page knows the answers to the questions about the situation, under every control."""

import csv
import json
import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.support.station_page import NEEDS_BROWSER, Looking
from tests.support.swarms import running, wait_until

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

pytestmark = [*NEEDS_BROWSER, pytest.mark.slow]

QUARTERS = ("top left", "top right", "bottom left", "bottom right")
SIDE_M = 40.0
"""The arena of `smoke` is square."""


class Reader(Looking):
    """Reads lists and counters of the page, as a person does who has all the time."""

    def answers(self) -> dict[str, str]:
        """What the page says now, by question; its lists follow the newest picture at once when they are sorted."""
        self.driver.execute_script("document.getElementById('agents-order').dispatchEvent(new Event('change'))")
        events = [re.search(r"at \(([\d.]+), ([\d.]+)\) m", line) for line in self.texts("#events-list .what")]
        places = [(float(found[1]), float(found[2])) for found in events if found]
        quarters = Counter(QUARTERS[2 * (y_m < SIDE_M / 2) + (x_m >= SIDE_M / 2)] for x_m, y_m in places)
        roots = []
        for name, what in zip(self.texts("#agents-list button"), self.texts("#agents-list .what"), strict=True):
            inside = re.search(r"in the tree of agent (\d+)", what)
            roots += [inside[1]] if inside else [name.split()[-1]] if what.startswith("root of a tree") else []
        most = [quarter for quarter in QUARTERS if quarters[quarter] == max(quarters.values(), default=0)]
        trees = {"agents_in_trees": str(len(roots)), "trees": str(len({*roots}))}
        return {"open_events": self.text("events-count"), "most_events": most[0], **trees}


@pytest.mark.parametrize("mode", ["decentralised", "hybrid"])
def test_who_only_reads_the_page_is_right_by_what_is_known(driver: "Chrome", tmp_path: Path, mode: str) -> None:
    """In all questions; by the truth it is not, which is the swarm's part."""
    keys = (
        *(f"control.mode={mode}", "run.duration_s=300", "operator.probes.isa_every_s=0", "uplink.latency_s=20"),
        *("operator.probes.sagat_count=4", "operator.page.hold_while_away=true", "operator.probes.situation_gap_s=50"),
        'operator.probes.sagat_questions=["open_events", "most_events", "trees", "agents_in_trees"]',
    )
    given = [word for pair in keys for word in ("--set", pair)]
    with running(tmp_path / "run", "--station", "--speed", "50", *given) as swarm:
        file = swarm.part / "station.json"
        wait_until(lambda: file.exists() and file.read_text().endswith("\n"), "the page")
        driver.get(json.loads(file.read_text())["url"])
        page = Reader(driver)
        for _ in range(4):
            page.until(lambda: page.at("form").is_displayed() and page.texts("#form-questions > *"))
            fields = driver.execute_script(
                "return [...document.querySelectorAll('#form-questions .question')].map((one) => one.textContent)"
            )
            answers = page.answers()
            for at, text in enumerate(fields):
                if "quarter" in text:
                    page.all(f"[name='question-{at}'][value='{answers['most_events']}']")[0].click()
                else:
                    item = "open_events" if "events" in text else "agents_in_trees" if "agents" in text else "trees"
                    page.at(f"question-{at}").send_keys(answers[item])
            page.at("form-send").click()
            page.until(lambda: not page.at("form").is_displayed())  # the next one comes a second later
        swarm.end_well()
    with (swarm.out / "situation.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 16
    assert [row for row in rows if row["is_right"] != "1"] == []
    assert [row["item"] for row in rows if row["is_known_true"] == "0"]
