"""Training is repeated until its criterion is reached, by real processes; a cut between two trainings loses nothing."""

from pathlib import Path
from typing import Any

import pytest

from tests.processes.test_asking_again import SCALES, Browser, a_session, end_well, table
from tests.support.swarms import PATIENCE_S, wait_until

pytestmark = pytest.mark.processes

FILE = """
schema = 1

[session]
speed = 0

[session.training]
label = "training"
scenario = "smoke"
set = ["run.duration_s=5", "operator.probes.isa_every_s=0", "operator.probes.tlx=true"]

[session.training.criterion]
metric = "tlx_raw"
at_most = 10
max_runs = 2

[[session.condition]]
label = "A"
scenario = "smoke"
set = ["run.duration_s=5", "operator.probes.isa_every_s=0"]

[[session.form]]
name = "you"
when = "before"
question = [{ name = "reliable", text = "Robots are reliable." }]
"""


class Relaxed(Browser):
    """Finds the training no effort."""

    @staticmethod
    def answer(probe: dict[str, Any], condition: str) -> dict[str, Any]:
        said = Browser.answer(probe, condition)
        return said | {"scales": dict.fromkeys(SCALES, 0)} if probe["kind"] == "tlx" else said


@pytest.mark.slow
def test_training_is_repeated_until_it_is_easy(tmp_path: Path) -> None:
    """The first is not; the second is cut off before it begins, and done again when the session goes on."""
    (tmp_path / "study.toml").write_text(FILE)
    folder = tmp_path / "sessions" / "study" / "participant-001"

    def page_of(run: str) -> Path:
        return folder / f"{run}.part" / "station.json"

    with a_session(tmp_path) as session:
        first = Browser(page_of("0-training"), tlx=True, condition="0 training")
        wait_until(page_of("0-training-2").exists, "the second training")
        session.terminate()
        assert session.wait(PATIENCE_S) == 130
    assert sorted(first.asked) == ["form", "sheet", "tlx"]
    assert table(tmp_path, "participants")[0]["training_outcome"] == "open"
    with a_session(tmp_path) as session:
        again = Relaxed(page_of("0-training-3"), tlx=True, condition="0 training")
        last = Browser(page_of("1-A"), tlx=False, condition="1 A")
        end_well(session)
    assert (again.asked, last.asked) == (["sheet", "tlx"], ["sheet"])
    [participant] = table(tmp_path, "participants")
    columns = ("training_runs", "training_outcome", "complete")
    assert [participant[column] for column in columns] == ["2", "reached", "2"]
    complete = [run for run in table(tmp_path, "runs") if run["complete"] == "1"]
    runs = [(run["run"], run["position"], run["training_value"]) for run in complete]
    assert runs == [("0-training", "0", "30.0"), ("0-training-3", "0", "0.0"), ("1-A", "1", "")]
