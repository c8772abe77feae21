"""Whole sessions of participants whose link dies, whose page is loaded again, whose browser is killed: all is there."""

import json
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

import pandas as pd
import pytest
from selenium.webdriver.common.by import By

from tests.pages.test_whole_session import CONDITION, FILE, Participant
from tests.support.cable import Cable, cable
from tests.support.station_page import NEEDS_BROWSER, browser
from tests.support.swarms import COMMAND, PATIENCE_S, wait_until

pytestmark = [*NEEDS_BROWSER, pytest.mark.slow]

SESSION = [*COMMAND, "session", "study.toml", "--quiet"]
FOUR = ("nothing", "dies", "reloads", "is_killed")
TWELVE = (*FOUR, "nothing", "dies", "nothing", "nothing", "nothing", "dies", "nothing", "nothing")
AT_A_TIME = 3
MAX_SESSION_S = 900.0

WORK = """
document.querySelector('#isa [data-answer="4"]').click();
const note = document.getElementById("note-text");
note.value = arguments[0];
note.dispatchEvent(new Event("input"));
document.getElementById("note-send").click();
"""
"""What a person does at once, though the next question may already wait over the page."""


class Unlucky(Participant):
    """Something happens to the page whenever ISA is asked; notes what was done, and how often."""

    def __init__(self, stack: ExitStack, link: Cable, url: str, fate: str) -> None:
        self.stack = stack
        self.link = link
        self.url = url
        super().__init__(stack.enter_context(browser()))
        self.driver.get(url)
        self.fate: Callable[[], None] = getattr(self, fate)
        self.done = 0

    def answer_isa(self) -> None:
        self.done += 1
        with self.doing("isa", "4"), self.doing("note", f"note {self.done}"):
            self.fate()
            wait_until(lambda: not self.at("isa").is_displayed(), "ISA is taken")

    def work_on(self) -> None:
        """Click on an answer and write a note."""
        self.driver.execute_script(WORK, f"note {self.done}")

    def nothing(self) -> None:
        self.work_on()

    def dies(self) -> None:
        """Answer over a link that swallows everything, and that is back once the page has given it up."""
        self.link.die()
        self.work_on()
        status = self.at("status")
        wait_until(lambda: status.get_attribute("data-state") == "lost", "the page gives up")
        assert self.at("isa").is_displayed()
        assert self.at("note-text").get_property("value") == f"note {self.done}"
        self.link.mend()

    def reloads(self) -> None:
        """Load the page again before anything is noted."""
        self.link.die()
        self.work_on()
        self.link.mend()
        self.driver.refresh()

    def is_killed(self) -> None:
        """Lose the browser, and open the page in another one after a while."""
        self.driver.quit()
        self.driver = self.stack.enter_context(browser())
        self.driver.get(self.url)
        wait_until(lambda: self.driver.find_elements(By.CSS_SELECTOR, "#isa:not([hidden])"), "ISA is asked again")
        self.work_on()


def take_part(folder: Path, number: int, fate: str) -> list[tuple[str, str, float, float]]:
    """Do the whole session of one participant; return the log of what was done."""
    file = folder / "sessions" / "study" / f"participant-{number:03}" / "station.json"
    with subprocess.Popen([*SESSION, "--participant", str(number), "--language", "de"], cwd=folder) as session:
        try:
            wait_until(lambda: file.exists() and file.read_text().endswith("\n"), "the page")
            url = json.loads(file.read_text())["url"]
            port = urlsplit(url).port or 0
            with cable(port) as link, ExitStack() as stack:
                near = url.replace(f":{port}/", f":{link.port}/")
                participant = Unlucky(stack, link, near, fate)
                wait_until(participant.work, "the thanks", MAX_SESSION_S)
                assert session.wait(PATIENCE_S) == 0
                return participant.log
        finally:
            session.kill()


@pytest.mark.timeout(2400)
@pytest.mark.parametrize("fates", [FOUR, TWELVE], ids=["four", "twelve"])
def test_every_input_of_unlucky_participants_is_in_the_tables_once(tmp_path: Path, fates: tuple[str, ...]) -> None:
    """Compared with the log of what each did, by kind, content and time; `page_away_s` tells of the absences."""
    (tmp_path / "study.toml").write_text(FILE + CONDITION.format("A", 2) + CONDITION.format("B", 3))
    (tmp_path / "consent.txt").write_text("You may stop at any time.")
    with ThreadPoolExecutor(AT_A_TIME) as several:
        logs = list(several.map(lambda one: take_part(tmp_path, *one), enumerate(fates, 1)))
    subprocess.run([*SESSION, "--table", "data"], cwd=tmp_path, check=True)
    tables = {name: pd.read_csv(tmp_path / "data" / f"{name}.tsv", sep="\t") for name in ("actions", "probes", "runs")}
    actions, runs = tables["actions"], tables["runs"]
    rows = [(number, *row) for number, log in enumerate(logs, 1) for row in log]
    log = pd.DataFrame(rows, columns=["participant", "kind", "what", "from_s", "to_s"])
    log = log.sort_values(["participant", "kind", "what", "from_s"]).reset_index(drop=True)
    given = actions[(actions.by == "person") & actions.kind.isin({*log.kind})].copy()
    given["what"] = [
        text if kind == "note" else f"{value:.0f}" if kind == "isa" else ""
        for kind, text, value in zip(given.kind, given.text, given.value, strict=True)
    ]
    given = given.sort_values(["participant", "kind", "what", "page_s"]).reset_index(drop=True)
    keys = ["participant", "kind", "what"]
    assert given[keys].to_numpy().tolist() == log[keys].to_numpy().tolist()
    assert ((log.from_s - 0.5 <= given.page_s) & (given.page_s <= log.to_s + 0.5)).all()
    assert actions[actions.input.notna()].groupby("participant").input.apply(lambda each: each.is_unique).all()
    isa = tables["probes"][tables["probes"].probe == "isa"]
    assert list(isa.value.astype(int)) == [4] * 2 * len(fates)
    assert list(runs.answers_missing) == [0] * 3 * len(fates)
    cut_off = [number for number, fate in enumerate(fates, 1) if fate == "dies"]
    assert runs[runs.participant.isin(cut_off) & (runs.position > 0)].page_away_s.min() > 3.0
    away = actions[(actions.kind == "page") & (actions.name == "away")]
    assert {*cut_off} <= {*away.participant}
