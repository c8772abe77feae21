"""Whole sessions of participants whose link dies, whose page is loaded again, whose browser is killed: all is there."""

import json
import subprocess
from collections.abc import Callable
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
        """Answer and write a note, while the fate has its way."""
        self.done += 1
        self.fate()
        wait_until(lambda: not self.at("isa").is_displayed(), "ISA is taken")

    def work_on(self) -> None:
        """Click on an answer and write a note."""
        self.driver.execute_script(WORK, f"note {self.done}")

    def nothing(self) -> None:
        """Answer as everybody does."""
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


@pytest.mark.timeout(1200)
def test_every_input_of_unlucky_participants_is_in_the_tables_once(tmp_path: Path) -> None:
    """Compared with what each did; the hold and `page_away_s` tell of the absences."""
    (tmp_path / "study.toml").write_text(FILE + CONDITION.format("A", 2) + CONDITION.format("B", 3))
    (tmp_path / "consent.txt").write_text("You may stop at any time.")
    command = [*COMMAND, "session", "study.toml", "--quiet"]
    fates = ("nothing", "dies", "reloads", "is_killed")
    done = {}
    for number, fate in enumerate(fates, 1):
        file = tmp_path / "sessions" / "study" / f"participant-{number:03}" / "0-training.part" / "station.json"
        with subprocess.Popen([*command, "--participant", str(number), "--language", "de"], cwd=tmp_path) as session:
            try:
                wait_until(lambda file=file: file.exists() and file.read_text().endswith("\n"), "the page")  # type: ignore[misc]
                url = json.loads(file.read_text())["url"]
                port = urlsplit(url).port or 0
                with cable(port) as link, ExitStack() as stack:
                    near = url.replace(f":{port}/", f":{link.port}/")
                    participant = Unlucky(stack, link, near, fate)
                    wait_until(participant.work, "the end of the session")
                    assert session.wait(PATIENCE_S) == 0
                    done[number] = participant.done
            finally:
                session.kill()
    subprocess.run([*command, "--table", "data"], cwd=tmp_path, check=True)
    tables = {name: pd.read_csv(tmp_path / "data" / f"{name}.tsv", sep="\t") for name in ("actions", "probes", "runs")}
    actions, runs = tables["actions"], tables["runs"]
    assert set(done.values()) == {2}
    for number in done:
        own = actions[actions.participant == number]
        counts = own.kind.value_counts()
        assert (counts["isa"], counts["note"], counts["sheet"], counts["tlx"]) == (2, 2, 3, 2), (number, counts)
        assert sorted(own[own.kind == "note"].text) == ["note 1", "note 2"]
        assert own[own.input.notna()].input.is_unique
        assert fates[number - 1] != "dies" or "away" in set(own[own.kind == "page"].name)
    isa = tables["probes"][tables["probes"].probe == "isa"]
    assert list(isa.value.astype(int)) == [4] * 8
    assert list(runs.answers_missing) == [0] * 12
    assert runs[(runs.participant == 2) & (runs.position > 0)].page_away_s.min() > 3.0
