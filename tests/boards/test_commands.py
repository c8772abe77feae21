"""Commands in open air: from the operator's base to boards and from board to board, signed; real processes."""

import json
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from websockets.sync.client import connect
from websockets.typing import Origin

from deltaswarm_agent.core.agent_core import FORGET_SENDER_S, Receiver
from deltaswarm_board.inbox import RadioInbox
from deltaswarm_board.process import command_check
from deltaswarm_board.settings import BoardSettings
from deltaswarm_operator.__main__ import main
from deltaswarm_operator.core.base import Base
from deltaswarm_wire.checked import load
from deltaswarm_wire.commands import BASE_ID, Command, Relayed, Signed, Target, encode_command, encode_relayed
from deltaswarm_wire.envelope import Sample, Sent, encode_sample, encode_sent
from deltaswarm_wire.keys import RADIO, REPORT, Keys
from deltaswarm_wire.operator_messages import REFUSED, decode_report
from deltaswarm_wire.session import use_one_worker_thread
from deltaswarm_wire.signing import make_key, signer
from tests.support.airborne import operating
from tests.support.complaints import Printed
from tests.support.fields import EVENT_AT, RUN, board_table, boards, endpoint, free_port, plain_peer
from tests.support.swarms import PATIENCE_S, wait_until

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

FAST = ("--accelerate", "5")
HOLD = Command(0, "hold", Target(), {"for_s": 300.0}, 1000.0)
SCRIPT = [{"at_s": 0.2, "name": "hold", "arguments": {"for_s": 300.0}, "life_s": 1000.0}]
KEYS = Keys(RUN)


def peer(*ports: int) -> zenoh.Session:
    return zenoh.open(plain_peer(*map(endpoint, ports)))


class Answers:
    """What agents say of commands in their reports: (agent, number) and the newest state."""

    def __init__(self, session: zenoh.Session) -> None:
        self.states: dict[tuple[int, int], int] = {}
        self.reports: dict[int, int] = {}
        self._subscriber = session.declare_subscriber(KEYS.agent("*", REPORT), self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        report = decode_report(sample.payload.to_bytes())
        self.reports[report.agent] = self.reports.get(report.agent, 0) + 1
        for number, state in report.answers:
            self.states[report.agent, number] = state


def table(agent: int, folder: Path, key: str, listens: int, *connects: int) -> dict[str, Any]:
    """A board that stands at the event and reports by itself."""
    air = {"listen": [endpoint(listens)], "connect": [endpoint(port) for port in connects], "operator_key": key}
    made = board_table(agent, (EVENT_AT[0] + agent, EVENT_AT[1]), air, folder)
    made["agent"] = {**made["agent"], "control": {"mode": "decentralised"}}
    made["log"] = {"every_s": 2.0}
    return made


def forged(number: int, sign: Callable[[bytes], bytes]) -> bytes:
    body = encode_command(HOLD._replace(number=number))
    return encode_relayed(Relayed(500, Signed(body, sign(body))))


@pytest.mark.parametrize(("has_clock", "obeyed"), [(True, [True, False, False]), (False, [True, True, True])])
def test_a_board_refuses_what_is_not_of_now(
    has_clock: bool, obeyed: list[bool], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Held back for ten hours, or by a clock that is late; without a clock only the signature counts. Said once."""
    settings = table(0, tmp_path, make_key(tmp_path / "operator.key"), free_port())
    settings["air"]["has_clock"] = has_clock
    verify, sign = command_check(load(BoardSettings, settings)), signer(tmp_path / "operator.key", RUN)

    def is_obeyed(ago_s: int) -> bool:
        body = encode_command(HOLD._replace(number=int(time.time()) - ago_s, life_s=60.0))
        return verify(Signed(body, sign(body)))

    assert [is_obeyed(ago_s) for ago_s in (0, 36_000, -36_000)] == obeyed
    assert len(caplog.records) == (obeyed.count(False) > 0)


def script(folder: Path, commands: Sequence[dict[str, Any]] = SCRIPT) -> list[str]:
    file = folder / "commands.toml"
    file.write_text(tomli_w.dumps({"command": commands}))
    key = str(folder / "operator.key")
    return ["--controller", "decentralised", "--command-key", key, "--commands", str(file)]


@pytest.mark.processes
def test_a_signed_command_is_relayed_and_a_forged_one_is_refused(tmp_path: Path) -> None:
    """Board 1 hears board 0 alone; board 2 has no key. What is forged reaches all by the base's key and by another."""
    public = make_key(tmp_path / "operator.key")
    make_key(tmp_path / "other.key")
    at, ports = free_port(), [free_port() for _ in range(3)]
    tables = [
        table(0, tmp_path, public, ports[0], at),
        table(1, tmp_path, public, ports[1], ports[0]),
        table(2, tmp_path, "", ports[2], at, ports[0]),
    ]
    with (
        boards(tmp_path) as running,
        peer(*ports) as hears,
        operating(tmp_path, "--listen", endpoint(at), "--base", "10,10", *script(tmp_path)) as operator,
    ):
        answers = Answers(hears)
        for one in tables:
            running.start(one, *FAST)
        wait_until(lambda: {agent for agent, _ in answers.states} >= {0, 1}, "answers of boards 0 and 1")
        [number] = {number for _, number in answers.states}
        assert REFUSED not in answers.states.values()

        with peer(*ports) as hostile:
            sign = signer(tmp_path / "other.key", RUN)
            for count in range(1, 2000):
                items = (forged(count, sign), forged(count + number, lambda body: b""))
                frame = encode_sample(Sample(4_000_000_000 + count, None, items))
                for sender in (BASE_ID, 7):
                    hostile.put(KEYS.agent(sender, RADIO), frame)
                if all("commands refused" in running.said(agent) for agent in range(3)):
                    break
                wait_until(lambda count=count: count % 10 or sum(answers.reports.values()) > count, "the boards go on")
            wait_until(lambda: all("commands refused" in running.said(agent) for agent in range(3)), "refusals")
        before = dict(answers.reports)
        wait_until(lambda: all(answers.reports[agent] > before[agent] + 3 for agent in range(3)), "later reports")
        assert {*answers.states} == {(0, number), (1, number)}
        _, totals = operator.end()
    [fate] = totals["commands"]
    assert (fate["number"], fate["name"], fate["heard"], fate["done"], fate["refused"]) == (number, "hold", 1, 1, 0)
    assert totals["frames"] >= 1
    assert str(number) in (operator.out / "actions.csv").read_text()


@pytest.mark.processes
def test_a_person_commands_from_the_page_and_again_after_a_restart(tmp_path: Path) -> None:
    """The second operator's command is new to a board that heard the first one's; each station ends with its operator.

    The first operator is killed. Its page offers no pace.
    """
    public = make_key(tmp_path / "operator.key")
    at, port = free_port(), free_port()
    table_of_one = table(0, tmp_path, public, port, at)
    options = ("--listen", endpoint(at), "--station", "--controller", "decentralised")
    with boards(tmp_path) as running, peer(port) as hears:
        answers = Answers(hears)
        running.start(table_of_one, *FAST)
        for count in (1, 2):
            folder = tmp_path / str(count)
            folder.mkdir()
            with operating(folder, *options, "--command-key", str(tmp_path / "operator.key")) as operator:
                url = operator.page
                with connect(
                    f"ws{url.removeprefix('http')}live", origin=Origin("/".join(url.split("/")[:3])), max_size=1 << 22
                ) as page:
                    told = [json.loads(page.recv(PATIENCE_S)) for _ in range(2)]
                    [hello] = [message for message in told if message["type"] == "hello"]
                    assert (hello["speeds"], hello["kind"]) == ([], "live")
                    assert "hold" in [form["name"] for form in hello["commands"]]
                    order = {"name": "hold", "target": {"kind": "all"}, "arguments": {"for_s": 10.0 * count}}
                    page.send(json.dumps({"type": "command", "id": "a", **order}))
                    wait_until(lambda count=count: len(answers.states) == count, f"answer {count}")
                    while not (rows := _picture(page)["commands"]) or not rows[0][6]:
                        pass
                    assert rows[0][:2] == [0, "hold"]
                    [station] = children(operator.process.pid)
                    (operator.process.kill if count == 1 else operator.process.terminate)()
                    operator.process.wait(PATIENCE_S)
                wait_until(lambda station=station: not Path(f"/proc/{station}").exists(), "the end of the station")
    assert len({number for _, number in answers.states}) == 2


def _picture(page: Any) -> dict[str, Any]:
    while (message := json.loads(page.recv(PATIENCE_S)))["type"] != "picture":
        pass
    return dict(message)


def children(pid: int) -> list[int]:
    done = subprocess.run(["pgrep", "-P", str(pid)], capture_output=True, text=True, check=False)
    return [int(line) for line in done.stdout.split()]


@pytest.mark.parametrize(
    ("place_m", "range_m", "is_heard"),
    [(None, 0.0, True), (None, 9.0, False), ((5.0, 0.0), 9.0, True), ((50.0, 0.0), 9.0, False)],
)
def test_the_base_is_as_far_as_it_says(place_m: tuple[float, float] | None, range_m: float, is_heard: bool) -> None:
    """A board that drops frames from beyond a range hears a base only with its place."""
    inbox = RadioInbox(3, 3.0, range_m)
    base = Base(1.0, 100)
    base.send([Signed(encode_command(HOLD))], 0.0)
    frame = base.frame(0.0)
    assert frame is not None
    assert inbox.accept(BASE_ID, frame, None if place_m is None else encode_sent(Sent(0.0, *place_m)), 0.0) == ""
    assert [sender for sender, _ in inbox.empty(0.0, (0.0, 0.0))] == ([BASE_ID] if is_heard else [])


def test_a_base_that_starts_again_is_heard_at_once() -> None:
    """Its frames' numbers begin with the time; one that begins lower is heard after a silence."""
    receiver = Receiver(3, 1.0)

    def relays(counter: int, now: int) -> bool:
        base = Base(1.0, counter)
        base.send([Signed(encode_command(HOLD))], 0.0)
        return bool(receiver.newest_of([(BASE_ID, base.frame(0.0) or b"")], now)[1])

    assert [relays(1000, 0), relays(1004, 4), relays(10, 5), relays(10, 4 + int(FORGET_SENDER_S))] == [1, 1, 0, 0]
    assert relays(10, 5 + int(FORGET_SENDER_S))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--station", "--controller", "hybrid"], "deltaswarm certificates --operator-key"),
        (["--commands", "/nowhere"], "deltaswarm certificates --operator-key"),
        (["--station-listen", "127.0.0.1:0"], "--station-listen needs --station"),
        (["--command-key", "KEY"], "needs --station or --commands"),
        (["--station", "--command-key", "KEY"], "needs --controller or --task"),
        (["--station", "--command-key", "KEY", "--controller", "nobody"], "nobody"),
        (["--station", "--command-key", "/nowhere", "--controller", "hybrid"], "/nowhere"),
        (["--commands", "SCRIPT", "--command-key", "KEY", "--controller", "potential"], "hold"),
    ],
)
def test_an_operator_refuses(arguments: Sequence[str], message: str, tmp_path: Path, capsys: Printed) -> None:
    make_key(tmp_path / "operator.key")
    script(tmp_path, [{"name": "hold"}])
    files = {"KEY": str(tmp_path / "operator.key"), "SCRIPT": str(tmp_path / "commands.toml")}
    given = [files.get(argument, argument) for argument in arguments]
    command = ["--no-world", "--run", RUN, "--out", str(tmp_path / "out"), "--listen", "tcp/127.0.0.1:0", *given]
    assert main(command) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
