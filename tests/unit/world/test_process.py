"""The world's process: no step is lost at the end of a run, what it is told is bounded, and its tables stay."""

import signal
import socket
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checkpoint
from deltaswarm_wire.checked import load
from deltaswarm_wire.child import FAILED
from deltaswarm_wire.keys import AGENT, OPERATOR, RECORDER, Keys
from deltaswarm_wire.orders import encode_taken
from deltaswarm_wire.session import RouterLink
from deltaswarm_world.__main__ import main
from deltaswarm_world.core.participants import MAX_RETURNS, Participants
from deltaswarm_world.core.retransmit_buffer import StepMessages
from deltaswarm_world.core.world import WorldCore
from deltaswarm_world.io.files import EVENTS_SO_FAR, WorldOutput
from deltaswarm_world.io.process import WorldProcess
from deltaswarm_world.io.saving import SavedWorld, WorldConfig
from deltaswarm_world.io.transport import Transport
from deltaswarm_world.io.wakeup import ControlInput, ControlQueue, Persisted, Token, Wakeup
from tests.support.complaints import Printed
from tests.support.swarms import wait_until

LAST = 3
AGENTS = [Token(AGENT, agent, True) for agent in range(6)]


class Fabric:
    """Transport and wakeup in one: brings message batch by batch, and keeps what is sent."""

    def __init__(self, batches: Iterable[list[Token | Persisted]]) -> None:
        self.control = ControlQueue()
        self.deadline = float("inf")
        self.stop_requested = False
        self.clocks: list[bytes] = []
        self.truths: list[bytes] = []
        self.has_left = False
        self._batches = iter(batches)

    def receive(self, taker: Any) -> bool:
        """A wake-up, with the next batch of message."""
        for message in next(self._batches):
            self.control.put(message)
        return False

    def __getattr__(self, name: str) -> Any:
        """There is always message at once, no report, and nobody who answers, was late or watches."""
        return lambda *_: None

    def clock(self, data: bytes) -> None:
        self.clocks.append(data)

    def truth(self, data: bytes) -> None:
        self.truths.append(data)

    def leave(self) -> None:
        self.has_left = True

    def stop(self) -> None:
        """As after a signal, once its time is up."""
        self.stop_requested, self.deadline = True, 0.0


COMES, GOES = Token(OPERATOR, 0, True), Token(OPERATOR, 0, False)


def begun(fabric: Fabric, folder: Path, expect: tuple[str, ...] = (OPERATOR,)) -> WorldProcess:
    scenario = load_scenario("smoke", [])
    config = WorldConfig("run", scenario, RouterLink(""), folder, folder, expect=expect, publish_truth=True)
    world = WorldProcess(config, cast(Transport, fabric), cast(Wakeup, fabric), SavedWorld.new(config))
    world.wait_for_all()
    return world


@pytest.mark.parametrize(
    "batches",
    [
        [[Persisted(OPERATOR, LAST)], [GOES]],
        [[Persisted(OPERATOR, LAST), GOES]],
        [[GOES], [Persisted(OPERATOR, 1)], [COMES], [Persisted(OPERATOR, LAST)], [GOES]],
        [[GOES, Persisted(OPERATOR, 1)], [COMES, Persisted(OPERATOR, LAST), GOES]],
        [
            [GOES],
            [Persisted(OPERATOR, 1), COMES],
            [GOES, Persisted(OPERATOR, 1), COMES],
            [Persisted(OPERATOR, LAST)],
            [GOES],
        ],
    ],
)
def test_the_world_stays_until_an_operator_has_all(batches: list[list[Token | Persisted]], tmp_path: Path) -> None:
    """However the message of one that dies and of its successor come together."""
    fabric = Fabric([[COMES, *AGENTS], *batches])
    world = begun(fabric, tmp_path)
    world.core.participants.step, world.loop.has_begun = LAST, True
    for step in range(LAST + 1):
        world.loop.buffer.add(StepMessages(step, [], b"%d" % step), now=True)
    world.goodbye()
    assert fabric.has_left
    lives = sum(message == GOES for batch in batches for message in batch)
    assert fabric.clocks == [b"0", b"1", b"2", b"3"] + [b"2", b"3"] * (lives - 1)


def test_a_step_that_was_told_is_on_file(tmp_path: Path) -> None:
    """Also if the operator goes in it and a signal comes before it is back."""
    fabric = Fabric([[COMES, *AGENTS], [GOES], []])
    world = begun(fabric, tmp_path)
    fabric.stop()
    with WorldOutput(tmp_path) as output, pytest.raises(InterruptedError):
        world.run(output)
    _, *rows = (tmp_path / "world.csv").read_text().splitlines()
    assert len(rows) == len(fabric.truths) == 1


def test_a_closed_step_is_told_and_on_file_whatever_ends_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here a radio model, which fails before the next step's frames are out."""
    fabric = Fabric([[COMES, *AGENTS]])
    world = begun(fabric, tmp_path)
    begin = world.core.begin

    def begin_or_fail(step: int, *more: Any) -> Any:
        if step == 1:
            raise ZeroDivisionError("a model of somebody")
        return begin(step, *more)

    monkeypatch.setattr(world.core, "begin", begin_or_fail)
    monkeypatch.setattr(world, "_collect", lambda: None)
    with WorldOutput(tmp_path) as output, pytest.raises(ZeroDivisionError):
        world.run(output)
    _, *rows = (tmp_path / "world.csv").read_text().splitlines()
    assert len(rows) == len(fabric.truths) == len(fabric.clocks) == 1


def test_a_step_is_told_before_the_world_waits_for_the_pace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A person at the station must see the newest step while the run is held."""
    fabric = Fabric([[COMES, *AGENTS]])
    world = begun(fabric, tmp_path)
    told = list[int]()
    monkeypatch.setattr(world, "_collect", lambda: None)
    monkeypatch.setattr(world.loop.gate, "may_begin", lambda step: step < 2)
    monkeypatch.setattr(world.loop.gate, "wait_s", lambda step: 1.0)

    def hold(condition: object, within_s: float) -> bool:
        told.append(len(fabric.clocks))
        fabric.stop()
        return True

    monkeypatch.setattr(world.loop, "wait_until", hold)
    with WorldOutput(tmp_path) as output:
        world.run(output)
    assert told[0] == 2


def test_a_signal_ends_the_wait_for_who_is_far_behind(tmp_path: Path) -> None:
    """Without an error: the run goes on, and its next step is the last."""
    fabric = Fabric([[COMES, *AGENTS], []])
    world = begun(fabric, tmp_path)
    world.loop.persisted = {RECORDER: 0}
    fabric.stop()
    world._let_catch_up(5000)


def test_a_checkpoint_without_the_operators_file_is_none(tmp_path: Path) -> None:
    """An operator may be killed before it writes it, and its successor confirms the step."""
    fabric = Fabric([[COMES, *AGENTS]])
    world = begun(fabric, tmp_path)
    world.core.participants.step, world.loop.persisted = LAST, {OPERATOR: LAST, RECORDER: LAST}
    folder = tmp_path / checkpoint.FOLDER
    _, operators, *agents = checkpoint.files(folder / str(LAST), range(len(AGENTS)))
    folder.mkdir()

    def save(asked: set[int], step: int) -> None:
        for file in agents:
            checkpoint.write(file, b"an agent")
        world.core.intake.unsaved -= asked

    fabric.save = save  # type: ignore[attr-defined]
    with WorldOutput(tmp_path) as output:
        world.save(LAST, output)
        assert not (folder / checkpoint.NEWEST).exists()
        checkpoint.write(operators, b"an operator")
        world.save(LAST, output)
    assert (folder / checkpoint.NEWEST).exists()


@pytest.mark.parametrize("late", [OPERATOR, RECORDER, AGENT])
def test_who_saved_another_step_completes_no_checkpoint(late: str, tmp_path: Path) -> None:
    """Not until it confirms this one: what it saved is of an earlier checkpoint, though its file may be there."""
    newest = tmp_path / checkpoint.FOLDER / checkpoint.NEWEST
    too_early = list[bool]()

    def batches() -> Iterator[list[Token | Persisted]]:
        yield [COMES, Token(RECORDER, 0, True), *AGENTS]
        for step in (LAST - 1, LAST):
            too_early.append(newest.exists())
            for role in (OPERATOR, RECORDER):
                if role != late:
                    yield [Persisted(role, LAST)]
            if late == AGENT:
                assert inbox.hear_saved(2, encode_taken(step)) is None
            else:
                yield [Persisted(late, step)]
            yield []

    fabric = Fabric(batches())
    world = begun(fabric, tmp_path, (OPERATOR, RECORDER))
    inbox = world.core.intake
    inbox.begin(LAST)
    inbox.await_saved({2})  # an earlier checkpoint, for which it was late
    world.core.participants.step = LAST
    files = checkpoint.files(newest.parent / str(LAST), range(len(AGENTS)))
    newest.parent.mkdir()

    def save(asked: set[int], step: int) -> None:
        for file in files[1:]:
            checkpoint.write(file, b"a part")
        for agent in asked - {2} if late == AGENT else asked:
            assert inbox.hear_saved(agent, encode_taken(step)) is None

    fabric.save = save  # type: ignore[attr-defined]
    with WorldOutput(tmp_path) as output:
        world.save(LAST, output)
    assert newest.exists()
    assert too_early == [False, False]


TOKENS = st.builds(Token, st.sampled_from([AGENT, OPERATOR]), st.integers(0, 2), st.booleans())


@given(st.lists(TOKENS | st.builds(Persisted, st.just(OPERATOR), st.integers(0, 9))))
def test_what_is_no_agents_comes_in_order_and_of_an_agents_the_newest_two(told: list[ControlInput]) -> None:
    queue = ControlQueue()
    for news in told:
        queue.put(news)
    taken = list(queue.drain())
    assert not list(queue.drain())

    def of(agent: int, found: list[ControlInput]) -> list[ControlInput]:
        return [news for news in found if isinstance(news, Token) and (news.role, news.number) == (AGENT, agent)]

    agents = [news for agent in range(3) for news in of(agent, told)]
    assert [news for news in taken if news not in agents] == [news for news in told if news not in agents]
    for agent in range(3):
        assert of(agent, taken) == of(agent, told)[-2:]


def test_who_comes_and_goes_without_end_is_taken_back_only_so_often() -> None:
    """A board always is: its link may fail as often as it will."""
    participants = Participants([0, 1, 2], boards=[2])
    for step in range(10 * MAX_RETURNS):
        participants.begin(step, [0])
        for agent in (1, 2):
            participants.token_gone(agent)
            participants.token_back(agent)
    assert participants.present == {0, 2}
    assert participants.lost == [1] * (MAX_RETURNS + 1)


@pytest.mark.parametrize("complete", [True, False])
@pytest.mark.parametrize("may_resume", [True, False])
def test_what_a_resumed_run_needs_stays(complete: bool, may_resume: bool, tmp_path: Path) -> None:
    """Also of a complete run, whose results may yet find the disk full."""
    with WorldOutput(tmp_path) as output:
        output.finish(WorldCore(load(Scenario, {})), complete, 0, may_resume=may_resume)
    assert (tmp_path / EVENTS_SO_FAR).exists() == (may_resume or not complete)
    assert (tmp_path / "events.csv").exists()


def test_a_table_with_steps_is_never_overwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """And a world that cannot listen makes none, so that its command can be repeated."""
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # this process keeps its handlers
    file, table = tmp_path / "scenario.toml", tmp_path / "world.csv"
    file.write_text(to_toml(load_scenario("smoke", [])))
    arguments = ["--scenario", str(file), "--run", "x", "--credentials", str(tmp_path / "credentials")]
    with socket.create_server(("127.0.0.1", 0)) as taken:
        arguments += ["--out", str(tmp_path), "--listen", f"tcp/127.0.0.1:{taken.getsockname()[1]}"]
        assert main(arguments) == FAILED
        assert not table.exists()
        table.write_text("step\n0\n")
        assert main(arguments) == 2
    assert "world.csv, which is never overwritten" in capsys.readouterr().err
    assert table.read_text() == "step\n0\n"


def test_no_sample_on_its_way_holds_up_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flood fills the queue again after the world's last look at it; Zenoh's thread must not wait there for ever."""
    monkeypatch.setattr(Transport, "_relieve", lambda _: None)
    settings = zenoh.Config()
    settings.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(settings) as session:
        keys = Keys("run")
        transport = Transport(session, keys, 1)

        sent: list[None] = []

        def flood() -> None:
            for _ in range(2 * transport.room):
                session.put(keys.agent(0, "report"), b"x")
                sent.append(None)

        flooder = threading.Thread(target=flood, daemon=True)
        flooder.start()
        wait_until(lambda: len(sent) == transport.room, "a full queue")
        transport.close()
        flooder.join(10.0)
        assert not flooder.is_alive()
