"""Kills of whatever takes part in a session: the person goes on at the same step, and every input counts once."""

import json
import random
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed

from tests.support.by_link import (
    Message,
    Participant,
    a_study,
    bad_links,
    heard,
    hosted,
    kill,
    links_of,
    person,
    rows,
    serving,
    socket_at,
    states,
    together,
    tokens,
)
from tests.support.swarms import BOUND_S, COMMAND, PATIENCE_S, told, wait_until
from tests.support.sweeping import marked, marked_command

pytestmark = pytest.mark.processes

RUNS = ("0-training", "1-A")
Until = Callable[[Message, Message], bool]


class Steps:
    """Where a person was; later pictures of the same run show no earlier step."""

    def __init__(self) -> None:
        self.run, self.step = "", 0

    def reached(self, step: int, run: str = "") -> Until:
        def holds(hello: Message, picture: Message) -> bool:
            assert hello["run"] != self.run or picture["step"] >= self.step - 1
            if is_there := hello["run"].endswith(run) and picture["step"] >= step:
                self.run, self.step = hello["run"], picture["step"]
            return bool(is_there)

        return holds


def frozen(file: Path) -> str:
    made = told("session", str(file), "--freeze", "--out", str(file.parent / "out"))
    return made.stdout.split()[0]


def check(file: Path, plan: str, orders: list[str]) -> None:
    """Every order is in the tables once, and the runs repeat to their digests."""
    acts = [row for run in RUNS for row in rows(file, 1, run, "actions")]
    assert [row["input"] for row in acts if row["kind"] == "command"] == orders
    verified = told("verify", str(file.parent / "out"), "--against", plan)
    assert (verified.returncode, "2 of 2 planned runs are complete" in verified.stdout) == (0, True), verified.stdout


@pytest.mark.parametrize("seed", [1, 2])
def test_whatever_is_killed_a_person_goes_on_where_they_were(tmp_path: Path, seed: int) -> None:
    """The session's process twice, then the service, whose folder and file go elsewhere: as to another machine."""
    chance = random.Random(seed)
    file = a_study(tmp_path / "here", speed=20.0)
    plan = frozen(file)
    links_of(file, 1)
    [token] = tokens(file)
    steps = Steps()
    with serving(file) as service:
        one = person(service.open_link, token)
        for step, run in ((chance.randrange(15, 50), RUNS[0]), (chance.randrange(15, 40), RUNS[1])):
            assert one.go_through(steps.reached(step, run)) is None
            kill(file.parent)
        assert one.go_through(steps.reached(chance.randrange(45, 80), RUNS[1])) is None
        service.kill()
    wait_until(lambda: not hosted(file.parent), "the end of the session's process")
    file = Path(shutil.move(file.parent, tmp_path / "there")) / file.name
    with serving(file) as service:
        one.link = person(service.open_link, token).link
        end = one.go_through()
    assert (end or {})["state"] == "complete"
    check(file, plan, one.orders)


@pytest.mark.slow
def test_twenty_kills_in_one_session(tmp_path: Path) -> None:
    """Processes and services at random steps of a run; never too often within ten minutes for the same service."""
    chance = random.Random(20)
    file = a_study(tmp_path, speed=20.0, condition_s=400)
    plan = frozen(file)
    links_of(file, 1)
    [token] = tokens(file)
    one, steps = Participant(""), Steps()
    at = sorted(chance.sample(range(5, 390), 20))
    for service_kills in (at[n : n + 4] for n in range(0, 20, 4)):
        with serving(file) as service:
            one.link = person(service.open_link, token).link
            for step in service_kills[:3]:
                assert one.go_through(steps.reached(step, RUNS[1])) is None
                kill(tmp_path)
            assert one.go_through(steps.reached(service_kills[3], RUNS[1])) is None
            service.kill()
        wait_until(lambda: not hosted(tmp_path), "the end of the session's process")
    with serving(file) as service:
        one.link = person(service.open_link, token).link
        assert (one.go_through() or {})["state"] == "complete"
    check(file, plan, one.orders)


@contextmanager
def session(file: Path) -> Iterator[tuple[subprocess.Popen[str], str, Participant]]:
    """`deltaswarm session` of participant 1, its mark, and the person at its page."""
    out = file.parent / "out"
    command = [*COMMAND, "session", str(file), "--out", str(out), "--participant", "1", "--json"]
    address = out / "participant-001" / "station.json"
    address.unlink(missing_ok=True)
    with marked_command(*command, DISPLAY="") as (process, mark):
        wait_until(lambda: address.exists() and address.read_text().endswith("\n"), "the page")
        yield process, mark, Participant(json.loads(address.read_text())["url"].removesuffix("run/"))


def test_a_killed_session_in_the_lab_goes_on_where_it_was(tmp_path: Path) -> None:
    """First its process, then the command, then Ctrl-C; nothing of it is left running, and each run has one attempt."""
    file = a_study(tmp_path, speed=20.0)
    plan, steps, orders = frozen(file), Steps(), []
    with session(file) as (process, mark, one):
        assert one.go_through(steps.reached(20, RUNS[0])) is None
        kill(tmp_path)
        assert one.go_through(steps.reached(10, RUNS[1])) is None
        orders += one.orders
        again = told("session", str(file), "--out", str(tmp_path / "out"), "--participant", "1")
        assert (again.returncode, "under way" in again.stderr) == (2, True)
        process.kill()
        wait_until(lambda: not marked(mark), "the end of all its processes", BOUND_S)
    with session(file) as (process, mark, one):
        one.done.add("participant-001/1-A order")
        assert one.go_through(steps.reached(40, RUNS[1])) is None
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130
        assert not marked(mark)
    with session(file) as (process, _, one):
        one.done.add("participant-001/1-A order")
        with suppress(ConnectionClosed, OSError):  # the address goes with the command
            one.go_through()
        printed, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, said
    assert [len(run["attempts"]) for run in json.loads(printed)["runs"]] == [1, 1]
    check(file, plan, orders)


def test_an_input_that_comes_while_the_process_starts_again_counts(tmp_path: Path) -> None:
    """The page is there at once, and shows what it knows; the process is not yet."""
    file = a_study(tmp_path, speed=20.0)
    links_of(file, 1)
    with serving(file) as service:
        one = person(service.open_link, tokens(file)[0])
        assert one.go_through(lambda hello, picture: picture["step"] >= 15) is None
        kill(tmp_path)
        wait_until(lambda: states(file) == ["waiting"], "the end of the process")
        one.at_door("running")
        with socket_at(one.link, "run/live") as page:
            run = heard(page, lambda message: message["type"] == "hello")["run"]
            one.put(page, run, "command", name="set delta", target={"kind": "all"}, arguments={"delta": 4})
        assert (one.go_through() or {})["state"] == "complete"
    acts = [row for run in ("0-training", "1-A") for row in rows(file, 1, run, "actions")]
    assert [row["input"] for row in acts if row["kind"] == "command"] == one.orders


def test_a_new_version_does_not_break_off_what_an_old_one_began(tmp_path: Path) -> None:
    """Another speed stands for other code: both are part of what a run must have in common with its beginning."""
    file = a_study(tmp_path, speed=20.0)
    links_of(file, 1)
    [token] = tokens(file)
    with serving(file) as service:
        one = person(service.open_link, token)
        assert one.go_through(Steps().reached(15)) is None
        service.kill()
    wait_until(lambda: not hosted(tmp_path), "the end of the session's process")
    file.write_text(file.read_text().replace("speed = 20.0", "speed = 21.0"))
    refused = told("serve", str(file), "--out", str(tmp_path / "out"))
    assert (refused.returncode, "participant-001/0-training" in refused.stderr) == (2, True), refused.stderr
    with serving(file, "--restart-runs") as service:
        one.link = person(service.open_link, token).link
        assert (one.go_through() or {})["state"] == "complete"
    record = json.loads((tmp_path / "out" / "participant-001" / "session.json").read_text())
    assert [len(run["attempts"]) for run in record["runs"]] == [2, 1]


@pytest.mark.slow
def test_links_that_die_stall_and_are_slow_lose_nothing(tmp_path: Path) -> None:
    file = a_study(tmp_path, speed=10.0, training_s=100, condition_s=200, more="at_once = 12\n")
    links_of(file, 12)
    with serving(file) as service, bad_links(service, tokens(file)) as people:
        ends = together(people, 300.0)
    assert [end and end["state"] for end in ends] == ["complete"] * 12
    for number, one in enumerate(people, 1):
        acts = [row for run in RUNS for row in rows(file, number, run, "actions")]
        assert [row["input"] for row in acts if row["kind"] == "command"] == one.orders
