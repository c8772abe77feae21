"""Runs with an operator who commands, by real processes: a person at the station, or a script."""

import csv
import json
import math
import os
import signal
import socket
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import pytest

from deltaswarm_operator.core.replay import Replay
from deltaswarm_operator.io import replaying
from deltaswarm_orchestrator.processes.station import free_address
from deltaswarm_orchestrator.recording.reader import RecordingError
from deltaswarm_orchestrator.recording.replay import write_steps
from tests.support import persons, swarms
from tests.support.branching import branched, summary_of
from tests.support.persons import CONSENT, Person
from tests.support.swarms import (
    BOUND_S,
    SMOKE_PROCESSES,
    UNHURRIED,
    RunningSwarm,
    is_running,
    running,
    sets,
    wait_until,
)

pytestmark = pytest.mark.processes

ALL = SMOKE_PROCESSES + 1
"""With the station."""

SCRIPT = (
    'command=[{at_s=0, name="set delta", arguments={delta=1}},'
    '{at_s=40, name="hold", target="circle", numbers=[20, 20, 9], arguments={for_s=30}},'
    '{at_s=40, name="attend", target="place", numbers=[10, 30], arguments={within_m=30}},'
    '{at_s=90, name="recall", target="tree", numbers=[2], arguments={pause_s=20}},'
    '{at_s=95, name="resume", target="agent", numbers=[3]},'
    '{at_s=120, name="set delta", target="tree", numbers=[1], arguments={delta=4}, life_s=30}]'
)
FAULTS = 'fault=[{kind="freeze", at_s=60, duration_s=40, agents=[2]}, {kind="kill", at_s=200, agents=[4]}]'
DOWNLINK = ("downlink.loss=0.3", "downlink.latency_s=1.5", "downlink.jitter_s=2", "radio.loss=0.2")


@contextmanager
def at_the_station(out: Path, *arguments: str) -> Iterator[tuple[RunningSwarm, Person]]:
    with running(out, "--station", *arguments) as swarm, Person(swarm) as person:
        yield swarm, person


def table(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def commands_of(run: Path) -> list[dict[str, Any]]:
    return list(tomllib.loads((run / "commands.toml").read_text())["command"])


def a_command(rng: Random) -> dict[str, Any]:
    """One that the paper's controller accepts."""
    place = {"x_m": rng.uniform(0, 40), "y_m": rng.uniform(0, 40)}
    tree, agent = {"kind": "tree", "root": rng.randrange(6)}, {"kind": "agent", "agent": rng.randrange(6)}
    target = rng.choice([{"kind": "all"}, {"kind": "circle", **place, "radius_m": rng.randint(1, 30)}, tree, agent])
    commands: list[dict[str, Any]] = [
        {"name": "set delta", "arguments": {"delta": rng.randint(1, 4)}, **target},
        {"name": "hold", "arguments": {"for_s": rng.choice([5, 12.5, 60])}, **target},
        {"name": "recall", "arguments": {"pause_s": rng.uniform(0, 60)}, **tree},
        {"name": "attend", "arguments": {"within_m": 40}, "kind": "place", **place},
        {"name": "resume", **target},
    ]
    return rng.choice(commands)


def test_scripted_commands_give_one_digest(tmp_path: Path) -> None:
    """By processes, in one process, and again from what was given, with everything that a downlink does."""
    air = sets("run.duration_s=200", *DOWNLINK)
    digest = swarms.run(tmp_path / "one", *sets(SCRIPT), *air)["digest"]
    assert [command["at_s"] for command in commands_of(tmp_path / "one")] == [2, 40, 40, 90, 95, 120]
    assert swarms.run(tmp_path / "two", *sets(SCRIPT), *air, "--in-process")["digest"] == digest
    given = str(tmp_path / "one" / "commands.toml")
    assert swarms.run(tmp_path / "again", *air, "--commands", given)["digest"] == digest
    assert swarms.run(tmp_path / "plain", *air, "--in-process")["digest"] != digest


def test_what_a_person_did_can_be_run_again_as_a_script(tmp_path: Path) -> None:
    """40 commands at random, more than a turn has room for in one pause, while agents freeze and die."""
    given = sets(
        FAULTS, "run.duration_s=300", CONSENT, "downlink.range_m=15", "downlink.base_m=[5, 5]", "downlink.loss=0.2"
    )
    rng = Random(13)
    numbers = []
    with at_the_station(tmp_path / "person", *given) as (swarm, person):
        person.begin(speed=50.0)
        for count in (*[1] * 6, 20, *[2] * 7):
            steps = rng.randint(1, 25)
            if count != 1:
                person.pause()
            for _ in range(count):
                command = a_command(rng)
                answer = person.command(command.pop("name"), arguments=command.pop("arguments", {}), **command)
                numbers.append(answer["number"])
            until = person.picture["step"] + steps
            person.say("pace", steps=steps)
            person.see(lambda picture, until=until: bool(picture["step"] >= until or picture["over"]))  # type: ignore[misc]
        assert not person.picture["over"]
        person.say("pace", speed=0)
        person.say("pace", paused=False)
        swarm.end_well()
    assert numbers == list(range(40))
    summary = swarm.summary()
    assert summary["valid"]
    assert summary["steps"] == 300
    assert len(commands_of(swarm.out)) == 40
    actions = table(swarm.out / "actions.csv")
    assert [int(action["command"]) for action in actions if action["kind"] == "command"] == numbers
    script = [*given, "--commands", str(swarm.out / "commands.toml")]
    assert swarms.run(tmp_path / "again", *script, "--in-process")["digest"] == summary["digest"]
    same = branched(swarm.out, tmp_path / "same", "--at", "150")
    assert summary_of(same)["digest"] == summary["digest"]
    without = branched(swarm.out, tmp_path / "without", "--drop-command", "30")
    assert [row["command"] for row in table(without / "commands.csv")] == [str(n) for n in range(40) if n != 30]


def test_an_operator_that_is_killed_loses_no_command_of_a_script(tmp_path: Path) -> None:
    """Also of 40 at once, of which some wait for a later turn: the digest is that of a run in one process."""
    burst = ",".join(f'{{at_s=60, name="set delta", arguments={{delta={1 + n % 4}}}}}' for n in range(40))
    given = sets(f"{SCRIPT[:-1]},{burst}]", "run.duration_s=200")
    with running(tmp_path / "run", *given, *UNHURRIED) as swarm:
        swarm.wait_until_under_way()
        swarm.wait_for_steps(30)
        swarm.signal("operator", signal.SIGKILL)
        swarm.end_well()
        assert swarm.manifest()["operator_restarts"] == 1
    other = swarms.run(tmp_path / "other", *given, "--in-process")
    assert swarm.summary()["digest"] == other["digest"]
    assert commands_of(swarm.out) == commands_of(tmp_path / "other")
    assert len(commands_of(swarm.out)) == 46


@pytest.mark.slow
def test_an_operator_that_is_killed_goes_on_with_its_person(tmp_path: Path) -> None:
    """The pause holds, consent is not asked for again, what was known is known, and the next command is the next."""
    with at_the_station(tmp_path / "run", *sets(CONSENT, "run.duration_s=200")) as (swarm, person):
        person.begin(speed=20.0)
        swarm.wait_until_under_way(ALL)
        assert person.command("hold", arguments={"for_s": 10})["number"] == 0
        person.pause()
        known = [person.picture[field] for field in ("step", "agents", "events", "unread", "workload")]
        before = swarm.pids["operator"]
        wait_until(lambda: (swarm.part / "operator-state.json").exists(), "the operator's state")
        swarm.signal("operator", signal.SIGKILL)
        wait_until(lambda: swarm.pids.get("operator", before) != before, "a new operator")
        person.see(lambda picture: picture["step"] == known[0] and picture["pace"] == {"paused": True, "speed": 20.0})
        assert [person.picture[field] for field in ("step", "agents", "events", "unread", "workload")] == known
        assert person.picture["probe"] is None
        assert person.command("hold", arguments={"for_s": 10})["number"] == 1
        person.say("pace", speed=0)
        person.say("pace", paused=False)
        swarm.end_well()
    assert swarm.summary()["valid"]
    again = swarms.run(
        tmp_path / "again", *sets("run.duration_s=200"), "--commands", str(swarm.out / "commands.toml"), "--in-process"
    )
    assert again["digest"] == swarm.summary()["digest"]


@pytest.mark.slow
def test_a_station_that_is_killed_in_a_pause_comes_back_at_its_address(tmp_path: Path) -> None:
    """The pause lasts until the person, whose page connects again, ends it; the run ends valid."""
    with at_the_station(tmp_path / "run", "--speed", "0", *sets(CONSENT), *UNHURRIED) as (swarm, person):
        person.begin()
        swarm.wait_until_under_way(ALL)
        person.pause()
        before = swarm.pids["station"]
        swarm.signal("station", signal.SIGKILL)
        wait_until(lambda: swarm.pids["station"] != before, "another station")
        with Person(swarm) as again:
            assert again.url == person.url
            assert again.picture["pace"]["paused"]
            again.say("pace", paused=False)
        swarm.end_well()
    assert swarm.summary()["valid"]
    assert swarm.summary()["steps"] == 300
    plain = swarms.run(tmp_path / "plain", "--in-process")
    assert swarm.summary()["digest"] == plain["digest"]


def test_a_station_that_is_killed_before_the_first_step_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The agents are still to come, and the run does not end for it."""
    monkeypatch.setenv("MAY_BEGIN", str(tmp_path / "go"))
    late = sets("control.mode=tests.support.unhurried:Late", "run.duration_s=5")
    with running(tmp_path / "run", "--station", *late) as swarm:
        before = wait_until(lambda: swarm.pids.get("station"), "the station")
        swarm.signal("station", signal.SIGKILL)
        wait_until(lambda: swarm.pids["station"] != before, "another station")
        (tmp_path / "go").touch()
        with Person(swarm) as person:
            person.say("pace", paused=False)
            swarm.end_well()
    assert (swarm.summary()["valid"], swarm.summary()["steps"]) == (True, 5)


def test_a_stopped_station_costs_the_run_nothing(tmp_path: Path) -> None:
    """It ends in time, with all steps and nothing lost."""
    with at_the_station(tmp_path / "run", *sets(CONSENT), *UNHURRIED) as (swarm, person):
        person.begin()
        wait_until(lambda: len(swarm.pids) == ALL, "all processes")
        swarm.signal("station", signal.SIGSTOP)
        swarm.end_well()
        assert swarm.summary()["valid"]
        assert swarm.summary()["steps"] == 300


def test_a_run_that_is_paused_ends_soon_after_ctrl_c(tmp_path: Path) -> None:
    """Also while the session's sheet is open, and where NASA-TLX would be asked at the end."""
    for name, consents in (("paused", True), ("sheet", False)):
        given = sets(CONSENT, "operator.probes.tlx=true")
        with at_the_station(tmp_path / name, *given, *UNHURRIED) as (swarm, person):
            wait_until(lambda swarm=swarm: len(swarm.pids) == ALL, "all processes")  # type: ignore[misc]
            if consents:
                person.begin()
                person.pause()
            pids = swarm.pids
            began_s = time.monotonic()
            swarm.interrupt()
            code, _, _ = swarm.finish()
            assert code == 130
            assert time.monotonic() - began_s < BOUND_S
            assert swarm.manifest()["exit_reason"] == "stopped by SIGINT"
            wait_until(lambda pids=pids: not any(map(is_running, pids.values())), "the end of all")  # type: ignore[misc]


def test_a_person_is_asked_during_the_run_and_after_it(tmp_path: Path) -> None:
    """ISA while it goes on and NASA-TLX once it is over; the answers are in the run's folder."""
    given = sets(CONSENT, "operator.probes.tlx=true", "operator.probes.isa_every_s=100", "run.duration_s=150")
    scales = {"mental": 5, "physical": 0, "temporal": 100, "performance": 50, "effort": 45, "frustration": 95}
    with at_the_station(tmp_path / "run", *given) as (swarm, person):
        person.begin(speed=20.0)
        probe = person.see(lambda picture: (picture["probe"] or {}).get("kind") == "isa")["probe"]
        person.say("isa", number=probe["number"], answer=4)
        person.say("note", text="Ä note,\nwith a line of its own")
        person.say("pace", speed=0)
        person.see(lambda picture: picture["probe"] == {"kind": "tlx"})
        assert person.picture["over"]
        person.say("tlx", scales={**scales, "effort": 101})
        assert person.hear("refused")
        person.say("tlx", scales=scales)
        swarm.end_well()
        assert person.hear("ended")
    rows = table(swarm.out / "probes.csv")
    assert [(row["probe"], row["value"]) for row in rows] == [
        ("isa", "4"),
        *(("tlx", str(value)) for value in scales.values()),
    ]
    actions = table(swarm.out / "actions.csv")
    kinds = sorted(action["kind"] for action in actions if action["kind"] != "page")  # each came by another browser
    assert kinds == sorted(["pace", "sheet", "isa", "note", "pace", "tlx"])
    pages = [action for action in actions if action["kind"] == "page"]
    assert [action["page"] for action in pages if action["name"] == "opened"][:2] == ["1", "2"]
    moments = [float(action["monotonic_s"]) for action in actions]
    assert moments == sorted(moments)
    assert len(table(swarm.out / "wall_times.csv")) == swarm.summary()["steps"]
    assert swarm.summary()["valid"]
    person = swarm.summary()["person"]
    assert (person["questions"], person["answers_missing"], person["isa"]) == (2, 0, 4)
    assert person["tlx"] == {"raw": pytest.approx(sum(scales.values()) / 6)}
    assert person["items"] == len(table(swarm.out / "inbox.csv"))


def test_a_run_is_held_exactly_for_questions_about_the_situation(tmp_path: Path) -> None:
    """As fast as it runs, no step is done meanwhile; the answers are compared with the truth; the digest stays."""
    given = sets(CONSENT, "operator.probes.isa_every_s=0", "run.duration_s=60", "run.step_s=0.5")
    held = sets("operator.probes.sagat_at_s=[20.0, 40.0]", "operator.probes.sagat_questions=['open_events', 'trees']")
    address = free_address("127.0.0.1:0")
    host, _, port = address.rpartition(":")
    with at_the_station(tmp_path / "run", *given, *held, "--markers", address) as (swarm, person):
        markers = socket.create_connection((host, int(port)), BOUND_S).makefile("rb")
        assert json.loads(markers.readline())["kind"] == "hello"
        person.begin(speed=0.0)
        for number, answers in enumerate(({"open_events": 2, "trees": 0}, {"open_events": 5, "trees": 9})):
            picture = person.see(lambda picture, number=number: (picture["probe"] or {}).get("number") == number)  # type: ignore[misc]
            assert picture["pace"]["paused"]
            assert person.ask("pace", paused=False)["type"] == "refused"
            person.say("form", form="sagat", answers=answers)
        swarm.end_well()
        kinds = [json.loads(line)["kind"] for line in markers]
    told = [kind for kind in kinds if kind in ("begin", "question", "answer", "end")]
    assert told[told.index("begin") :] == [  # before it comes the sheet, of which only an early listener is told
        "begin", *["question", "question", "answer", "answer"] * 2, "end"
    ]  # fmt: skip
    records = {float(row["time_s"]): row for row in table(swarm.out / "series.csv")}
    rows = table(swarm.out / "situation.csv")
    assert sorted((float(row["asked_s"]), row["item"]) for row in rows) == [
        (time_s, item) for time_s in (20.0, 40.0) for item in ("open_events", "trees")
    ]
    columns = {"open_events": "events_open", "trees": "trees"}
    assert [row["truth"] for row in rows] == [records[float(row["asked_s"])][columns[row["item"]]] for row in rows]
    times = table(swarm.out / "wall_times.csv")
    closed = {float(row["time_s"]): float(row["monotonic_s"]) for row in times}
    for probe in table(swarm.out / "probes.csv"):
        assert closed[float(probe["asked_s"])] <= float(probe["answered_monotonic_s"])
        assert closed[float(probe["asked_s"]) + 0.5] >= float(probe["answered_monotonic_s"])
    assert swarms.run(tmp_path / "plain", *given, "--in-process")["digest"] == swarm.summary()["digest"]


def test_questions_without_an_answer_are_named(tmp_path: Path) -> None:
    """The run is complete, and the summary says what is missing; each scale has a row."""
    given = sets("operator.probes.tlx=true", "operator.probes.isa_every_s=0", "run.duration_s=20")
    with at_the_station(tmp_path / "run", *given) as (swarm, person):
        person.see(lambda picture: picture["probe"] == {"kind": "tlx"})
        swarm.signal("station", signal.SIGTERM)
        swarm.end_well()
    assert [(row["probe"], row["value"]) for row in table(swarm.out / "probes.csv")] == [("tlx", "")] * 6
    assert swarm.summary()["person"]["answers_missing"] == 1


@pytest.mark.slow
def test_a_run_that_was_killed_can_be_replayed(tmp_path: Path) -> None:
    """As far as its recording goes, with what had been reported, and what a person had commanded."""
    steps = tmp_path / "steps.msgpack"
    with at_the_station(tmp_path / "run", *sets(CONSENT, "run.duration_s=1000000")) as (swarm, person):
        person.begin(speed=50.0)  # faster, its recording grows as fast as it is read
        assert person.command("hold", "circle", {"for_s": 9}, x_m=5, y_m=6, radius_m=7)["type"] == "accepted"

        person.see(lambda picture: bool(picture["unread"]))
        first, *_ = person.ask("read", all=True)["items"]

        def is_readable() -> bool:
            try:
                write_steps(swarm.part, steps)
            except (RecordingError, OSError):
                return False
            found = replaying.read(steps)[1]
            return len(found) > 100 and any(step.read for step in found)

        wait_until(is_readable, "a hundred steps of the recording")
        pids = swarm.pids
        os.killpg(swarm.process.pid, signal.SIGKILL)
        swarm.process.communicate()
        wait_until(lambda: not any(map(is_running, pids.values())), "the end of all")
        write_steps(swarm.part, steps)
        briefing, found = replaying.read(steps)
    assert briefing.title.startswith("smoke")
    replay = Replay(briefing, found)
    replay.seek(math.inf)
    [command] = replay.show()["commands"]
    assert command[:4] == [0, "hold", ["circle", 5, 6, 7], {"for_s": 9}]
    assert first in {item for step in found for item in step.read}
    assert [step.clock.step for step in found] == list(range(len(found)))
    assert found[-1].clock.last
    assert any(step.reports for step in found)
    assert sum(len(step.reports) for step in found) == sum(step.workload.messages for step in found)


def test_the_page_is_told_by_a_command_only_while_there_is_one(tmp_path: Path) -> None:
    """`deltaswarm station` knows the address of a run under way."""
    with at_the_station(tmp_path / "run", *sets(CONSENT)) as (swarm, person):
        command = [*swarms.COMMAND, "station", str(tmp_path / "run")]
        told = swarms.subprocess.run(command, capture_output=True, text=True, check=True, env=persons.headless())
        assert told.stdout.strip() == person.url.geturl()
        for run in (".", str(tmp_path / "run.part")):
            here = swarms.subprocess.run(
                [*command[:-1], run], capture_output=True, text=True, cwd=tmp_path / "run.part", env=persons.headless()
            )
            assert here.stdout == told.stdout
        person.begin()
        assert swarm.finish()[0] == 0
        assert swarms.subprocess.run(command, capture_output=True, text=True, check=False).returncode == 1
