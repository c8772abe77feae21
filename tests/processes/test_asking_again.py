"""A session asks again for answers that a run has not got, on the same page, and its tables have them."""

import csv
import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from tests.support.persons import headless
from tests.support.swarms import COMMAND, PATIENCE_S, wait_until

pytestmark = pytest.mark.processes

TRAINING = """
schema = 1

[session]
speed = {}

[session.training]
label = "training"
scenario = "smoke"
set = ["run.duration_s=5", "operator.probes.isa_every_s=0"]

[[session.condition]]
label = "A"
scenario = "smoke"
"""
FILE = f"""{TRAINING.format(0)}
set = ["run.duration_s=5", "operator.probes.isa_every_s=0", "operator.probes.tlx=true"]

[[session.form]]
name = "trust"
question = [
    {{ name = "reliable", text = "The swarm is reliable." }},
    {{ name = "why", text = "Why?", kind = "text", required = false }},
]
"""
PROCESSES = ("--agents", "processes")
"""Then a run ends with the command, and what was not answered is asked later; else both would go on where they were."""

SCALES = {"mental": 60, "physical": 0, "temporal": 60, "performance": 0, "effort": 60, "frustration": 0}


class Browser:
    """Answers what a session's page asks in the run after that of `after`, until this run has ended."""

    def __init__(
        self, folder: Path, tlx: bool, condition: str = "", *, judges: bool = False, after: "Browser | None" = None
    ) -> None:
        address = folder / "station.json"
        wait_until(lambda: address.exists() and address.read_text().endswith("\n"), str(address))
        self.url = json.loads(address.read_text())["url"]
        self.asked: list[str] = []
        self.run = after.run if after else ""
        while not self.is_over(tlx, condition, judges):
            pass

    def is_over(self, tlx: bool, condition: str, judges: bool) -> bool:
        """Answer until the run has ended, or the page has moved since the session has not begun."""
        before = self.run
        live = f"{self.url.replace('http', 'ws', 1)}live"
        origin: Any = self.url[: self.url.index("/", 8)]
        with connect(live, origin=origin, max_size=1 << 22, ping_interval=None, open_timeout=PATIENCE_S) as socket:
            answered, is_judged = None, not judges
            while True:
                message = json.loads(socket.recv(PATIENCE_S))
                if message["type"] == "moved":
                    return False
                if message["type"] == "hello":
                    self.run = message["run"]
                if self.run == before:
                    continue
                if not is_judged and message.get("events"):
                    socket.send(json.dumps({"type": "judge", "event": message["events"][0][0], "answer": "target"}))
                    is_judged = True
                if message["type"] == "ended":
                    return True
                if message["type"] == "picture":  # ten times a second
                    socket.send(json.dumps({"type": "beat"}))
                probe = message.get("probe")
                if probe is None or probe == answered:
                    continue
                if probe["kind"] == "tlx" and not tlx:
                    return True
                answered = probe
                self.asked.append(probe["kind"])
                self.probe = probe
                socket.send(json.dumps(self.answer(probe, condition)))

    @staticmethod
    def answer(probe: dict[str, Any], condition: str) -> dict[str, Any]:
        if probe["kind"] == "sheet":
            return {"type": "sheet", "consent": True, "participant": "P001", "condition": condition}
        if probe["kind"] == "tlx":
            return {"type": "tlx", "scales": SCALES}
        answers = {"reliable": 6} if probe["form"]["question"] else {}
        return {"type": "form", "form": probe["form"]["name"], "answers": answers}


@contextmanager
def a_session(folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """The session of participant 1 of the folder's `study.toml`, under way."""
    command = [*COMMAND, "session", "study.toml", "--quiet", "--participant", "1", *options]
    with subprocess.Popen(command, cwd=folder, env=headless(), stderr=subprocess.PIPE, text=True) as session:
        try:
            yield session
        finally:
            session.kill()


def end_well(session: subprocess.Popen[str]) -> None:
    assert session.wait(PATIENCE_S) == 0, session.stderr and session.stderr.read()


def test_what_was_not_answered_is_asked_again(tmp_path: Path) -> None:
    """The person leaves before NASA-TLX; the run is kept, and the next start of the session asks what is missing."""
    (tmp_path / "study.toml").write_text(FILE)
    folder = tmp_path / "sessions" / "study" / "participant-001"
    with a_session(tmp_path, *PROCESSES) as session:
        first = Browser(folder, tlx=True, condition="0 training")
        second = Browser(folder, tlx=False, condition="1 A", after=first)
        session.terminate()  # so does the experimenter
        assert session.wait(PATIENCE_S) == 130
    assert (first.asked, second.asked) == (["sheet"], ["sheet"])
    assert json.loads((folder / "1-A" / "summary.json").read_text())["complete"]
    assert table(tmp_path, "runs")[1]["answers_missing"] == "2"
    with a_session(tmp_path) as session:
        third = Browser(folder, tlx=True)
        end_well(session)
    assert third.asked == ["tlx", "form"]
    [_, run] = table(tmp_path, "runs")
    assert (run["run"], run["answers_missing"], run["tlx_raw"]) == ("1-A", "0", "30.0")
    given = {(row["probe"], row["item"]): row["value"] for row in table(tmp_path, "probes")}
    assert given == {("tlx", scale): str(value) for scale, value in SCALES.items()} | {
        ("trust", "reliable"): "6",
        ("trust", "why"): "",
    }
    record = json.loads((folder / "session.json").read_text())
    assert [run["attempts"][-1]["answers_missing"] for run in record["runs"]] == [0, 0]
    with a_session(tmp_path) as session:  # nothing is left to ask
        end_well(session)


TASK = f"""{TRAINING.format(30)}
set = ["run.duration_s=120", "operator.probes.isa_every_s=0", "operator.task.target_share=0.9", "events.rate_hz=0.5"]
"""


@pytest.mark.slow
def test_a_session_shows_the_score_of_the_task(tmp_path: Path) -> None:
    """After the run, on a page of its own; all tables have it."""
    (tmp_path / "study.toml").write_text(TASK)
    folder = tmp_path / "sessions" / "study" / "participant-001"
    with a_session(tmp_path) as session:
        training = Browser(folder, tlx=True, condition="0 training")
        first = Browser(folder, tlx=True, condition="1 A", judges=True, after=training)
        second = Browser(folder, tlx=True, after=first)
        end_well(session)
    assert (first.asked, second.asked) == (["sheet"], ["form"])
    task = json.loads((folder / "1-A" / "summary.json").read_text())["task"]
    assert task["events"] > task["hits"] + task["false_alarms"] == 1
    assert f"{task['hits']} of {task['events']}" in second.probe["form"]["text"]
    assert [row["answer"] for row in table(tmp_path, "judgements") if row["answer"]] == ["target"]
    _, run = table(tmp_path, "runs")
    assert (int(run["hits"]), int(run["unjudged"])) == (task["hits"], task["events"] - 1)


def table(folder: Path, name: str) -> list[dict[str, str]]:
    subprocess.run([*COMMAND, "session", "study.toml", "--table", "data"], cwd=folder, check=True, capture_output=True)
    with (folder / "data" / f"{name}.tsv").open(newline="") as stream:
        return list(csv.DictReader(stream, delimiter="\t"))
