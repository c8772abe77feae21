"""The operator as a real process: over loopback, through a router with its access rules, ended in every way."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_operator.io.files import OperatorFiles
from deltaswarm_operator.io.process import End
from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_wire.child import WORLD_LOST
from deltaswarm_wire.keys import REPORT
from deltaswarm_wire.operator_messages import Clock, Forwarded, Workload, encode_report
from deltaswarm_wire.session import use_one_worker_thread
from tests.support.operating import AGENTS, KEYS, World, report
from tests.support.swarms import PATIENCE_S

use_one_worker_thread()

pytestmark = pytest.mark.processes


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with World(tmp_path) as made:
        yield made


def test_every_report_of_a_step_is_counted_in_that_step(world: World) -> None:
    """The clock follows the reports that the world hands on. At no clock is one missing, or early."""
    steps = 150
    process = world.running_operator()
    expected = WorkloadMeter(OperatorSettings(), 1.0)
    wanted = []
    for step in range(steps):
        for agent in range(AGENTS):
            if (step + agent) % 3:
                one = report(agent, step, step)
                expected.count(one, encode_report(one))
                world.hand_on(encode_report(one), step)
        world.close_step(step, last=step == steps - 1)
        wanted.append(expected.close_step(Clock(step, float(step), False), 0))
    assert process.wait(PATIENCE_S) == 0
    assert [row._replace(backlog=0) for row in world.rows()] == wanted
    totals = world.totals()
    assert totals["complete"] is True
    assert totals["digest"] == expected.digest_hex
    assert totals == {**totals, **expected.totals}
    assert (totals["lost"], totals["held"]) == (0, 0)


def test_it_hears_the_world_and_no_agent(world: World) -> None:
    """What an agent puts on its own key does not reach it; what the fabric loses behind the world is found."""
    process = world.running_operator()
    world.session.put(KEYS.agent(1, REPORT), encode_report(report(1, 0, 0)))
    for skipped, step in ((0, 0), (0, 1), (2, 1)):
        world.hand_on(encode_report(report(2, 9 - skipped, 0)), step, skipped)
        if not step:
            world.close_step(0)
    world.close_step(1, last=True)
    assert process.wait(PATIENCE_S) == 0
    assert [(row.messages, row.lost, row.rejected) for row in world.rows()] == [(1, 0, 0), (2, 2, 0)]


def test_a_recorder_gets_the_workload_of_every_step(world: World) -> None:
    """With --publish-all the operator is not ready before somebody listens; then nothing is left out."""
    process = world.start_operator("--publish-all", piped=True)
    assert process.stderr is not None
    assert b"deltaswarm/test/operator/workload" in process.stderr.readline()
    seen = world.workloads()
    world.wait_for_operator()
    for step in range(300):
        world.close_step(step, last=step == 299)
    assert [seen.get(timeout=PATIENCE_S).step for _ in range(300)] == list(range(300))
    assert b"the operator is ready" in process.communicate(timeout=PATIENCE_S)[1]
    assert process.returncode == 0


def test_those_who_watch_get_the_last_workload(world: World) -> None:
    """Without --publish-all a few of the steps are published, the last among them."""
    seen = world.workloads()
    process = world.running_operator()
    for step in range(1000):
        world.close_step(step, last=step == 999)
    assert process.wait(PATIENCE_S) == 0
    published = []
    while not published or published[-1] < 999:
        published.append(seen.get(timeout=PATIENCE_S).step)
    assert len(published) < 500


def test_what_breaks_the_protocol_is_counted_and_told_once(world: World) -> None:
    """Malformed bytes, a clock that is none or stands still: the operator goes on."""
    process = world.running_operator()
    for data in (b"", b"\xc1", encode_report(report(2, 0, 0))):
        world.hand_on(data)
    world.clock.put(b"\x00")
    world.close_step(0)
    world.close_step(0)
    world.close_step(1, last=True)
    assert process.wait(PATIENCE_S) == 0
    assert [(row.messages, row.rejected) for row in world.rows()] == [(1, 2), (0, 0)]
    log = world.log.read_text()
    assert log.count("report: sample") == 1
    assert log.count("dropped") == 1


def test_one_that_is_killed_goes_on_where_it_was(world: World) -> None:
    """Three times: whatever it had not confirmed it gets once more, and each report counts once."""
    expected = WorldMeter()
    kept: dict[int, bytes] = {}
    for life in range(4):
        process = world.start_operator(*(["--go-on"] if life else []))
        world.wait_for_operator()
        confirmed = world.taken.get(timeout=PATIENCE_S)
        first = 150 * life
        for step in range(first, first + 150):
            kept[step] = encode_report(report(step % AGENTS, step, step))
            expected.take(step, kept[step])
        for step in range(confirmed + 1, first + 150):
            world.hand_on(kept[step], step, number=step)
            world.close_step(step, last=step == 599)
        if life < 3:
            world.wait_until_taken(first + 50)
            world.kill(process)
            while not world.taken.empty():
                world.taken.get()
    assert process.wait(PATIENCE_S) == 0
    assert [row._replace(backlog=0) for row in world.rows()] == expected.rows
    assert world.totals() == {**world.totals(), **expected.meter.totals, "digest": expected.meter.digest_hex}
    assert sorted(path.name for path in world.out.iterdir()) == ["operator.csv", "operator.json"]


def test_a_successor_says_again_what_may_not_have_been_heard(world: World) -> None:
    """With --publish-all: who was killed had closed all steps, and had not sent the workload of one."""
    process = world.start_operator("--publish-all")
    seen = world.workloads()
    world.wait_for_operator()
    for step in range(5):
        world.hand_on(encode_report(report(1, step, step)), step)
        world.close_step(step)
    world.wait_until_taken(4)
    world.kill(process)
    before = [seen.get(timeout=PATIENCE_S) for _ in range(5)]
    process = world.start_operator("--publish-all", "--go-on")
    world.wait_for_operator()
    assert [seen.get(timeout=PATIENCE_S) for _ in range(5)] == before
    world.close_step(5, last=True)
    assert process.wait(PATIENCE_S) == 0
    assert world.rows()[:5] == before


@pytest.mark.parametrize("is_there", [True, False])
def test_who_is_killed_after_the_last_step_leaves_a_whole_run(world: World, is_there: bool) -> None:
    """Another one ends in its place, whether the world is still there to say that it was the last step, or goes."""
    process = world.start_operator()
    world.wait_for_operator()
    world.close_step(0)
    world.wait_until_taken(0)
    world.kill(process)
    with OperatorFiles(world.out, Workload._fields, go_on=True) as kept:
        meter, _ = kept.state
        meter.is_over = True
        kept.save((meter, None))
    process = world.start_operator("--go-on")
    world.wait_for_operator()
    if is_there:
        world.close_step(0, last=True)
    else:
        world.token.undeclare()
    assert process.wait(PATIENCE_S) == 0
    assert world.totals()["complete"]
    assert len(world.rows()) == 1


class WorldMeter:
    """What an operator that nobody kills counts of one report per step."""

    def __init__(self) -> None:
        self.meter = WorkloadMeter(OperatorSettings(), 1.0)
        self.rows: list[Workload] = []

    def take(self, step: int, data: bytes) -> None:
        self.meter.count_forwarded(Forwarded(step, step, data))
        self.rows.append(self.meter.close_step(Clock(step, float(step), False), 0))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_what_it_has(world: World, number: signal.Signals) -> None:
    process = world.running_operator()
    seen = world.workloads()
    world.hand_on(encode_report(report(1, 0, 0)))
    world.close_step(0)
    seen.get(timeout=PATIENCE_S)
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == 128 + number
    assert [row.messages for row in world.rows()] == [1]
    totals = world.totals()
    assert totals["complete"] is False
    assert (totals["end"], totals["messages"]) == (End.STOPPED.value, 1)


def test_it_ends_when_the_worlds_token_goes(world: World) -> None:
    """An exit code that says so, a clear message, and every step that was closed before."""
    process = world.running_operator()
    for step in range(500):
        world.close_step(step)
    world.token.undeclare()
    assert process.wait(PATIENCE_S) == WORLD_LOST
    assert [row.step for row in world.rows()] == list(range(500))
    assert world.totals()["complete"] is False
    assert f"ERROR deltaswarm.operator: {End.WORLD_GONE.value}: 500 steps" in world.log.read_text()


ROUTER = """
import sys
import zenoh
from deltaswarm_wire.keys import OPERATOR, WORLD, Keys
from deltaswarm_wire.operator_messages import Clock, decode_workload, encode_clock
from deltaswarm_wire.session import RouterLink, configured, router_pairs

endpoint, credentials, with_token = sys.argv[1:]
keys, link = Keys("test"), RouterLink(endpoint)
with zenoh.open(configured(zenoh.Config, router_pairs(link, credentials, keys, []), link)) as session:
    token = session.liveliness().declare_token(keys.token(WORLD)) if with_token == "True" else None
    taken = session.declare_subscriber(keys.all_taken, zenoh.handlers.RingChannel(1))
    tokens = session.liveliness().declare_subscriber(keys.token(OPERATOR), zenoh.handlers.FifoChannel(8), history=True)
    workloads = session.declare_subscriber(keys.workload, zenoh.handlers.FifoChannel(8))
    print("listening", flush=True)
    tokens.recv()
    for step in range(3):
        session.put(keys.clock, encode_clock(Clock(step, step, False)))
        workloads.recv()
    print("three steps closed", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("with_token", [True, False])
def test_it_ends_when_the_world_is_killed(tmp_path: Path, with_token: bool) -> None:
    """With kill -9, whether the world had come so far as to declare its token or not."""
    with World(tmp_path) as world:
        world.session.close()  # the router that is killed takes its place
        router = subprocess.Popen(
            [sys.executable, "-P", "-c", ROUTER, world.endpoint, str(tmp_path / "credentials"), str(with_token)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert router.stdout is not None
        assert router.stdout.readline() == b"listening\n"
        process = world.start_operator("--publish-all")
        assert router.stdout.readline() == b"three steps closed\n"
        router.kill()
        router.communicate()
        assert process.wait(PATIENCE_S) == WORLD_LOST
        assert [row.step for row in world.rows()] == [0, 1, 2]
        assert world.totals()["end"] == End.WORLD_GONE.value


def test_it_does_not_start_without_a_world(world: World) -> None:
    """A router that refuses its password is as good as none, and nothing is written."""
    process = world.start_operator(password="wrong")
    assert process.wait(PATIENCE_S) == WORLD_LOST
    assert world.endpoint in world.log.read_text()
    assert not world.out.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--step-s", "0"], "run.step_s must"),
        (["--threshold-hz", "nan"], "--threshold-hz: must"),
        (["--password-file", "/nonexistent/secret"], "No such file"),
        (["--zenoh", "mode"], "KEY=VALUE"),
    ],
)
def test_bad_arguments_are_refused_before_anything_starts(world: World, arguments: list[str], said: str) -> None:
    assert world.start_operator(*arguments).wait(PATIENCE_S) == 2
    assert said in world.log.read_text()
    assert not world.out.exists()
