"""A run's last steps, while parts are killed, leave or fall far behind: no step is lost."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire import checkpoint
from deltaswarm_wire.keys import AGENT, OPERATOR, RECORDER
from deltaswarm_wire.orders import encode_taken
from deltaswarm_wire.session import RouterLink
from deltaswarm_world.core.retransmit_buffer import ClosedStep
from deltaswarm_world.io.files import WorldOutput
from deltaswarm_world.io.process import WorldProcess
from deltaswarm_world.io.saving import SavedWorld, WorldConfig
from deltaswarm_world.io.transport import Transport
from deltaswarm_world.io.wakeup import ControlQueue, Persisted, Token, Wakeup

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
        """A step is handed on."""
        self.clocks.append(data)

    def truth(self, data: bytes) -> None:
        """A step is told to the recorder."""
        self.truths.append(data)

    def leave(self) -> None:
        """The world's token goes."""
        self.has_left = True

    def stop(self) -> None:
        """As after a signal, once its time is up."""
        self.stop_requested, self.deadline = True, 0.0


COMES, GOES = Token(OPERATOR, 0, True), Token(OPERATOR, 0, False)


def begun(fabric: Fabric, folder: Path, expect: tuple[str, ...] = (OPERATOR,)) -> WorldProcess:
    """A world for which all have come."""
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
    world._core.participants.step, world._loop.has_begun = LAST, True
    for step in range(LAST + 1):
        world._loop.buffer.add(ClosedStep(step, [], b"%d" % step), now=True)
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


def test_a_signal_ends_the_wait_for_who_is_far_behind(tmp_path: Path) -> None:
    """Without an error: the run goes on, and its next step is the last."""
    fabric = Fabric([[COMES, *AGENTS], []])
    world = begun(fabric, tmp_path)
    world._loop.persisted = {RECORDER: 0}
    fabric.stop()
    world._let_catch_up(5000)


def test_a_checkpoint_without_the_operators_file_is_none(tmp_path: Path) -> None:
    """An operator may be killed before it writes it, and its successor confirms the step."""
    fabric = Fabric([[COMES, *AGENTS]])
    world = begun(fabric, tmp_path)
    world._core.participants.step, world._loop.persisted = LAST, {OPERATOR: LAST, RECORDER: LAST}
    folder = tmp_path / checkpoint.FOLDER
    _, operators, *agents = checkpoint.files(folder / str(LAST), range(len(AGENTS)))
    folder.mkdir()

    def save(asked: set[int], step: int) -> None:
        for file in agents:
            checkpoint.write(file, b"an agent")
        world._core.intake.unsaved -= asked

    fabric.save = save  # type: ignore[attr-defined]
    with WorldOutput(tmp_path) as output:
        world._save(LAST, output)
        assert not (folder / checkpoint.NEWEST).exists()
        checkpoint.write(operators, b"an operator")
        world._save(LAST, output)
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
    inbox = world._core.intake
    inbox.begin(LAST)
    inbox.await_saved({2})  # an earlier checkpoint, for which it was late
    world._core.participants.step = LAST
    files = checkpoint.files(newest.parent / str(LAST), range(len(AGENTS)))
    newest.parent.mkdir()

    def save(asked: set[int], step: int) -> None:
        for file in files[1:]:
            checkpoint.write(file, b"a part")
        for agent in asked - {2} if late == AGENT else asked:
            assert inbox.hear_saved(agent, encode_taken(step)) is None

    fabric.save = save  # type: ignore[attr-defined]
    with WorldOutput(tmp_path) as output:
        world._save(LAST, output)
    assert newest.exists()
    assert too_early == [False, False]
