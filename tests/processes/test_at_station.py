"""A person at the station of a run in one process: the same run as by processes, also if it is killed on the way."""

import csv
import json
import random
from pathlib import Path
from typing import Any

import pytest

from tests.support.seats import Page, seated
from tests.support.swarms import told

pytestmark = pytest.mark.processes

SEEDS = (1, 2)
KILLS = 4
STEPS = 300
KEYS = (
    f"run.duration_s={STEPS}",
    "record=off",
    "operator.probes.isa_every_s=0",
    "operator.probes.tlx=true",
    "operator.page.hold_while_away=true",
)


def summary(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "run" / "summary.json").read_text())
    return content


def rows(folder: Path, table: str) -> list[dict[str, str]]:
    with (folder / "run" / f"{table}.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def order(page: Page, number: int, delta: int) -> None:
    """Give an order, and wait until it is noted."""
    page.say("command", id=f"order-{number}", name="set delta", target={"kind": "all"}, arguments={"delta": delta})
    page.hear(lambda message: message["type"] == "noted" and message["id"] == f"order-{number}")


def answer_and_end(page: Page) -> int:
    page.see(lambda picture: bool(picture["over"]) and (picture["probe"] or {}).get("kind") == "tlx")
    scales = dict.fromkeys(("mental", "physical", "temporal", "performance", "effort", "frustration"), 50)
    page.say("tlx", id="tlx", scales=scales)
    page.hear(lambda message: message["type"] == "noted" and message["id"] == "tlx")
    page.say("beat", rtt_s=0.0, done=True)
    page.hear(lambda message: message["type"] == "ended")
    return page.ended()


def repeated(folder: Path) -> str:
    """The digest of the run when processes repeat it from its orders."""
    out = folder / "repeated"
    scenario = ["smoke", *(word for key in KEYS for word in ("--set", key))]
    again = told("run", *scenario, "--commands", str(folder / "run" / "commands.toml"), "--out", str(out))
    assert again.returncode == 0, again.stderr
    digest: str = json.loads((out / "summary.json").read_text())["digest"]
    return digest


@pytest.mark.parametrize("seed", SEEDS)
def test_a_run_that_is_killed_again_and_again_goes_on_where_it_was(tmp_path: Path, seed: int) -> None:
    """Kills at random moments: every order counts once, and processes repeat the run to its digest."""
    chance = random.Random(seed)
    given, killed_at = 0, list[int]()
    while len(killed_at) < KILLS:
        with seated(tmp_path, *KEYS) as page:
            shown = page.see(lambda picture: True)
            assert shown["step"] >= (killed_at[-1] if killed_at else -1)
            page.say("pace", speed=chance.choice([20.0, 50.0]))
            until = shown["step"] + chance.randrange(3, STEPS // (KILLS + 2))
            page.see(lambda picture, until=until: picture["step"] >= until)
            order(page, given, chance.randrange(1, 6))
            given += 1
            killed_at.append(page.see(lambda picture: True)["step"])
            page.kill()
    with seated(tmp_path, *KEYS) as page:
        page.say("pace", speed=0.0)
        assert answer_and_end(page) == 0
    done = summary(tmp_path)
    acts = [row["input"] for row in rows(tmp_path, "actions") if row["kind"] == "command"]
    assert acts == [f"order-{number}" for number in range(KILLS)]
    assert (done["complete"], done["valid"], len(rows(tmp_path, "wall_times"))) == (True, True, STEPS)
    assert done["person"]["tlx"]["raw"] == 50.0
    assert done["digest"] == repeated(tmp_path)


def test_an_input_that_was_noted_before_the_kill_is_only_answered_again(tmp_path: Path) -> None:
    with seated(tmp_path, *KEYS) as page:
        page.see(lambda picture: True)
        order(page, 0, 2)
        page.kill()
    with seated(tmp_path, *KEYS) as page:
        page.see(lambda picture: True)
        order(page, 0, 2)
        page.say("pace", speed=0.0)
        assert answer_and_end(page) == 0
    assert len(rows(tmp_path, "commands")) == 1


def test_time_in_which_nobody_was_there_counts_as_absence(tmp_path: Path) -> None:
    with seated(tmp_path, *KEYS) as page:
        page.say("pace", speed=50.0)
        page.see(lambda picture: picture["step"] >= 5)
        page.kill()
    with seated(tmp_path, *KEYS) as page:  # says nothing until it was noted
        file = tmp_path / "run.part" / "actions.csv"
        while not file.exists() or ",page," not in file.read_text() or "away" not in file.read_text():
            assert json.loads(page.end.recv(1 << 20))["type"]
        page.say("pace", speed=0.0)
        assert answer_and_end(page) == 0
    assert summary(tmp_path)["person"]["page_away_s"] > 2
