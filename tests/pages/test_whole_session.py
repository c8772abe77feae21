"""A scripted participant does a whole session in a browser, at one address; the data say what was done, and when."""

import csv
import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

import pandas as pd
from selenium import webdriver
from selenium.common.exceptions import NoSuchElementException, StaleElementReferenceException
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement

from tests.support.station_page import NEEDS_BROWSER, browser
from tests.support.swarms import COMMAND, PATIENCE_S, wait_until

pytestmark = NEEDS_BROWSER

FILE = """
schema = 1

[session]
speed = 10.0
consent = "consent.txt"

[session.training]
label = "training"
scenario = "smoke"
set = ["run.duration_s=10", "operator.probes.isa_every_s=0", "run.start_timeout_s=240"]

[[session.form]]
name = "you"
when = "before"
question = [{ name = "age", text = "How old are you?", kind = "number", low = 18, high = 99 }]

[[session.form]]
name = "trust"
when = "between"
question = [{ name = "reliable", text = "The swarm is reliable." }]
"""
CONDITION = """
[[session.condition]]
label = "{}"
scenario = "smoke"
set = [
    "control.delta={}", "run.duration_s=40", "run.start_timeout_s=240", "operator.probes.tlx=true",
    "operator.probes.isa_every_s=25", "operator.probes.isa_jitter_s=0", "operator.probes.isa_wait_s=200",
    "operator.probes.sagat_at_s=[26]", "operator.probes.sagat_questions=['trees']",
]
"""
"""The run is held soon after the question of ISA, so that there is time to answer it on a slow machine, too."""

ANSWERS = {"age": 30, "reliable": 5, "trees": 2}
TLX = """
for (const slider of document.querySelectorAll("#tlx input[type=range]")) {
    slider.value = 40;
    slider.dispatchEvent(new Event("input"));
}
"""
FIELDS = "#form-questions input[type=number], #form-questions [value='5']"


class Participant:
    """Answers whatever the page asks, and notes when: before the click, and once the page has taken it."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver
        self.isa: list[tuple[float, float]] = []
        self.log: list[tuple[str, str, float, float]] = []
        """What was done: its kind and content, and the wall time before and after it."""

    @contextmanager
    def doing(self, kind: str, what: str = "") -> Iterator[None]:
        """Log what is done, once the page says that it is noted."""
        before = time.time()
        yield
        self.log.append((kind, what, before, time.time()))

    def at(self, name: str) -> WebElement:
        return self.driver.find_element(By.ID, name)

    def work(self) -> bool:
        """Do what is to be done now, unless the page loads again meanwhile; True once the session is over."""
        with suppress(NoSuchElementException, StaleElementReferenceException):
            self.do_next()
            return self.at("plain-title").text.startswith("Vielen Dank")
        return False

    def do_next(self) -> None:
        if self.at("sheet").is_displayed():
            if (agree := self.at("sheet-agree")).is_displayed() and not agree.is_selected():
                agree.click()
            with self.doing("sheet"):
                self.at("sheet-begin").click()
                wait_until(lambda: not self.at("sheet").is_displayed(), "the sheet is taken")
        elif self.at("form").is_displayed():
            self.fill()
        elif self.at("tlx").is_displayed():
            self.driver.execute_script(TLX)
            with self.doing("tlx"):
                self.at("tlx-send").click()
                wait_until(lambda: not self.at("tlx").is_displayed(), "NASA-TLX is taken")
        elif self.at("isa").is_displayed():
            self.answer_isa()

    def answer_isa(self) -> None:
        """Give an order, and click on an answer."""
        self.driver.execute_script("document.getElementById('command-send').click()")
        before = time.time()
        self.driver.execute_script("document.querySelector('#isa [data-answer=\"3\"]').click()")
        wait_until(lambda: not self.at("isa").is_displayed(), "ISA is taken")
        self.isa.append((before, time.time()))

    def fill(self) -> None:
        title = self.at("form-title").text
        [field] = self.driver.find_elements(By.CSS_SELECTOR, FIELDS)
        if field.get_attribute("type") == "number":
            field.clear()
            field.send_keys(str(ANSWERS["age" if title == "you" else "trees"]))
        else:
            field.click()
        with self.doing("form"):
            self.at("form-send").click()
            wait_until(lambda: not self.at("form").is_displayed() or self.at("form-title").text != title, "it is taken")


def test_a_whole_session(tmp_path: Path) -> None:
    """Consent, forms, training, two conditions with ISA, SAGAT and NASA-TLX; read by pandas in three lines.

    The participant reads German; the tables are those of any language. Each run repeats to its digest, with its orders.
    """
    (tmp_path / "study.toml").write_text(FILE + CONDITION.format("A", 2) + CONDITION.format("B", 3))
    (tmp_path / "consent.txt").write_text("You may stop at any time.")
    command = [*COMMAND, "session", "study.toml", "--quiet"]
    folder = tmp_path / "sessions" / "study" / "participant-001"
    subprocess.run([*command, "--freeze"], cwd=tmp_path, check=True)
    with subprocess.Popen(
        [*command, "--participant", "1", "--language", "de"], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    ) as session:
        try:
            address = folder / "station.json"
            wait_until(lambda: address.exists() and address.read_text().endswith("\n"), "the page's address")
            with browser() as driver:
                participant = Participant(driver)
                driver.get(json.loads(address.read_text())["url"])
                wait_until(participant.work, "the end of the session")
                assert session.wait(PATIENCE_S) == 0, session.stderr and session.stderr.read()
        finally:
            session.kill()
    subprocess.run([*command, "--table", "data"], cwd=tmp_path, check=True)
    runs = pd.read_csv(tmp_path / "data" / "runs.tsv", sep="\t")
    probes = pd.read_csv(tmp_path / "data" / "probes.tsv", sep="\t")
    assert sorted(runs.condition) == ["A", "B", "training"]
    set_by = dict(zip(runs.condition, runs["set"], strict=True))
    assert [set_by[label].partition(";")[0] for label in "AB"] == ["control.delta=2", "control.delta=3"]
    assert set(runs.scenario) == {"smoke"}
    assert list(pd.read_csv(tmp_path / "data" / "participants.tsv", sep="	").language) == ["de"]
    assert list(runs.answers_missing) == [0, 0, 0]
    assert list(runs[runs.position > 0].tlx_raw) == [40.0, 40.0]
    given = {(probe, item, value) for probe, item, value in zip(probes.probe, probes.item, probes.value, strict=True)}
    assert {("you", "age", 30), ("trust", "reliable", 5), ("sagat", "trees", 2), ("isa", "isa", 3)} <= given
    isa = probes[probes.probe == "isa"].sort_values("answered_monotonic_s")
    assert len(isa) == len(participant.isa) > 0
    for utc, (before, after) in zip(isa.answered_utc, participant.isa, strict=True):
        assert before - 0.1 <= datetime.fromisoformat(utc).timestamp() <= after + 0.1
    actions = pd.read_csv(tmp_path / "data" / "actions.tsv", sep="\t")
    assert set(actions[actions.kind == "sheet"].position) == {0, 1, 2}
    assert len(actions[(actions.kind == "command") & (actions.by == "person")]) == 2
    against = json.loads((folder.parent / "commitment.json").read_text())["hash"]
    subprocess.run([*COMMAND, "verify", "sessions/study", "--against", against], cwd=tmp_path, check=True)
    with (folder / "0-training" / "actions.csv").open(newline="") as stream:
        assert any("consent_sha256=" in row["text"] for row in csv.DictReader(stream))
