"""A run with a participant, a watcher and a conductor, each at a page of their own, by real processes."""

import csv
import json
from pathlib import Path

import pytest

from deltaswarm_orchestrator.base.exits import INTERRUPTED
from tests.support import swarms
from tests.support.persons import CONSENT, Person
from tests.support.swarms import PATIENCE_S, running, sets

pytestmark = pytest.mark.processes


def test_the_conductor_sees_both_and_the_participant_never_sees_the_truth(tmp_path: Path) -> None:
    """What is asked and done reaches the conductor, whose notes and pauses are recorded; digests do not change."""
    given = sets("operator.probes.isa_every_s=0", "run.duration_s=60", "operator.page.pace=false")
    pages = ("--station", "--researcher", *sets(CONSENT))
    with running(tmp_path / "run", *pages, *given) as swarm, Person(swarm) as person:
        with Person(swarm, "researcher_url") as conductor, Person(swarm, "watch_url") as watcher:
            assert conductor.see(lambda picture: picture["probe"] == {"kind": "sheet"})
            watcher.say("sheet", consent=True)
            assert "watches" in watcher.hear("refused")["why"]
            person.say("sheet", consent=True)
            act = conductor.hear("act")["act"]
            while act["kind"] != "sheet":
                act = conductor.hear("act")["act"]
            truth = conductor.hear("truth")
            assert len(truth["agents"]) == 6
            conductor.say("pace", paused=True)
            held = person.see(lambda picture: bool(picture["pace"]["paused"]))
            assert person.ask("pace", id="p", paused=False)["type"] == "refused"
            conductor.say("note", text="a noise")
            person.say("help", state="asked", id="h")
            assert conductor.see(lambda picture: picture["help"] == "asked")
            conductor.say("help", state="seen")
            assert person.see(lambda picture: picture["help"] == "seen")
            assert "conductor" in conductor.command("hold")["why"]
            conductor.say("pace", speed=0)
            conductor.say("pace", paused=False)
            seen = person.hear("picture")
            while not seen["over"]:
                assert "truth" not in seen
                seen = person.hear("picture", "truth", "act", "ended")
                assert seen["type"] == "picture"
        swarm.end_well()
    with (swarm.out / "actions.csv").open(newline="") as stream:
        rows = [(row["kind"], row["by"], row["text"]) for row in csv.DictReader(stream) if row["kind"] != "page"]
    notes = [("note", "conductor", "a noise")]
    assert [row for row in rows if row[0] == "note"] == notes
    others = [("help", "conductor"), ("help", "person"), *[("pace", "conductor")] * 3, ("sheet", "person")]
    assert sorted(row[:2] for row in rows if row[0] != "note") == others
    assert held["step"] < 60
    plain = swarms.run(tmp_path / "plain", *given, "--in-process")
    assert plain["digest"] == swarm.summary()["digest"]


def test_the_conductor_ends_a_run(tmp_path: Path) -> None:
    """In order, as a signal would: it is not complete, and its acts are on disk."""
    given = sets(CONSENT, "run.duration_s=600", "operator.probes.isa_every_s=60")
    with running(tmp_path / "run", "--station", "--researcher", *given) as swarm, Person(swarm) as person:
        person.begin(1.0)
        with Person(swarm, "researcher_url") as conductor:
            assert conductor.see(lambda picture: picture["step"] > 0)["next"]["what"] == "isa"
            conductor.say("end", id="e")
            assert conductor.hear("noted", "refused")["type"] == "noted"
            person.hear("ended")
        assert swarm.process.wait(PATIENCE_S) == INTERRUPTED
    [part] = tmp_path.glob("run*")
    summary = json.loads((part / "summary.json").read_text())
    assert (summary["complete"], summary["exit_reason"]) == (False, "stopped by the conductor")
    with (part / "actions.csv").open(newline="") as stream:
        assert ("end", "conductor") in {(row["kind"], row["by"]) for row in csv.DictReader(stream)}
