"""Whether a page answers, what an absence does to a run and its questions, and that each input counts once."""

import csv
import json
import socket
from pathlib import Path
from typing import Any

from deltaswarm_operator.core.console import INPUTS_KEPT, Console
from deltaswarm_operator.core.page_beats import AWAY_AFTER_S, PageBeats
from deltaswarm_operator.io.console_server import Channel, ConsoleServer, Outlet
from tests.support.commanding import briefing, taken_over
from tests.unit.operator.test_console import attended, close, report, say, shown

HOLDS = {"page": {"hold_while_away": True}}


def test_an_absence_counts_from_the_last_beat_and_within_the_run() -> None:
    """Not before the first step, and up to the newest one if nobody has come back."""
    beats = PageBeats()
    beats.start(100.0)
    assert beats.check(100.0 + AWAY_AFTER_S) is None
    assert beats.check(103.5) == 100.0
    beats.close_step(110.0)
    assert beats.beat(114.0) == 14.0
    assert beats.away_s == 4.0
    assert beats.check(116.0) is None
    assert beats.beat(117.0) is None
    assert beats.check(121.0) == 117.0
    assert beats.check(122.0) is None
    beats.close_step(125.0)
    assert beats.away_s == 12.0


def acts(console: Console) -> list[tuple[str, float | None]]:
    return [(act.name, act.monotonic_s) for act in console.actions if act.kind == "page"]


def test_a_page_that_is_gone_is_noted_and_the_run_goes_on() -> None:
    console = attended()
    assert say(console, "beat", 0.5) == [{"type": "beat", "to": 3}]
    close(console, 0, wall_s=1.0)
    console.watch_page(3.0)
    assert acts(console) == []
    console.watch_page(4.0)
    console.watch_page(5.0)
    assert not console.is_held
    close(console, 1, wall_s=6.0)
    say(console, "beat", 8.0)
    assert acts(console) == [("away", 4.0), ("back", 8.0)]
    assert [act.text for act in console.actions] == ["for 3.5 s", "after 7.5 s"]
    assert console.totals["person"]["page_away_s"] == 7.0


def test_a_run_waits_for_its_page_if_it_is_to() -> None:
    """For the first one, and for one that was killed; a pause of the person stays a pause."""
    console = attended(**HOLDS)
    assert console.is_held
    say(console, "beat", 9.0)
    assert not console.is_held
    close(console, 0, wall_s=10.0)
    console.watch_page(20.0)
    assert console.is_held
    assert shown(console)["pace"]["paused"]
    say(console, "note", 30.0, text="here again")
    assert not console.is_held
    say(console, "pace", 31.0, paused=True)
    console.watch_page(40.0)
    say(console, "beat", 41.0)
    assert console.is_held


def test_no_time_to_answer_passes_while_no_page_answers() -> None:
    """The question stays open, none is asked meanwhile, and the page's clock says how long the answer took."""
    console = attended(probes={"isa_every_s": 1.0, "isa_wait_s": 20.0})
    say(console, "beat", 0.0)
    close(console, 1, wall_s=0.0)
    assert shown(console, 2.0)["probe"]["left_s"] == 18.0
    console.watch_page(10.0)
    for step in range(2, 60):
        close(console, step, wall_s=float(step))
    assert shown(console, 60.0)["probe"] == {"kind": "isa", "number": 0, "asked_s": 1.0, "left_s": 20.0}
    say(console, "isa", 60.0, id="a", number=0, answer=4, shown_s=1000.25, page_s=1002.5, sent_s=1060.0)
    row = console.probes.rows[-1]
    assert {one.outcome for one in console.probes.rows[:-1]} == {"not asked: another question was open"}
    assert (row.value, row.reaction_s, row.shown_page_s, row.answered_page_s) == (4, 2.25, 1000.25, 1002.5)
    assert console.actions[-1].delay_s == 57.5
    close(console, 60, wall_s=61.0)
    assert console.probes.outcomes["questions"] == 2


def asked_isa(left_s: float) -> Console:
    """A console whose page was last heard at 20 s, when there was so much time left to answer ISA."""
    console = attended(probes={"isa_every_s": 1.0, "isa_wait_s": 15.0})
    for second in range(1, 21):
        say(console, "beat", float(second))
        console.watch_page(float(second))
        if second == 5 + left_s:
            close(console, 1, wall_s=float(second))
    assert shown(console, 20.0)["probe"]["left_s"] == left_s
    return console


def answered(console: Console, wall_s: float, **clock: float) -> bool:
    """Whether an answer is accepted that was made some time before."""
    return not say(console, "isa", wall_s, number=0, answer=4, **clock)


def test_an_answer_that_was_made_in_time_counts_though_it_comes_late() -> None:
    """Also if the link died when the time was nearly over; one that was made too late is refused."""
    for silence_s, page_s in ((1.2, 100.5), (2.5, 100.5), (60.0, 100.5)):
        console = asked_isa(left_s=1.0)
        for tenth in range(1, int(10 * silence_s)):
            console.watch_page(20.0 + tenth / 10)
            shown(console, 20.0 + tenth / 10)
        assert console.probes.rows == []
        assert answered(console, 20.0 + silence_s, page_s=page_s, sent_s=100.0 + silence_s)
        assert console.probes.rows[0].value == 4
    console = asked_isa(left_s=1.0)
    assert not answered(console, 21.2, page_s=101.2, sent_s=101.2)
    console = asked_isa(left_s=1.0)
    say(console, "beat", 21.2)
    console.watch_page(21.2)
    assert shown(console, 21.2)["probe"] is None
    assert [row.value for row in console.probes.rows] == [None]


def test_a_beat_before_the_answer_does_not_close_the_question() -> None:
    """After a stall both arrive at once, in the order in which they were sent."""
    console = asked_isa(left_s=1.0)
    console.watch_page(22.4)
    say(console, "beat", 22.5)
    console.watch_page(22.5)
    shown(console, 22.5)
    assert answered(console, 22.5, page_s=100.5, sent_s=100.5)


def test_all_that_is_read_is_what_the_page_has() -> None:
    console = Console(briefing())
    for step in range(3):
        close(console, step, report(step, step))
    [told] = say(console, "read", all=True, up_to=1)
    assert told["items"] == [0, 1]
    assert set(range(3)) - console.ledger.read_s.keys() == {2}


def test_an_input_that_is_sent_again_counts_once() -> None:
    """And has the same answer, also from the operator that replaces a killed one; a refused one is judged anew."""
    console = Console(briefing())
    console.attend()
    order = {"id": "p-1", "name": "go", "target": {"kind": "all"}}
    first = say(console, "command", **order)
    assert [answer["type"] for answer in first] == ["accepted", "noted"]
    assert say(console, "command", **order) == first
    assert say(taken_over(console, has_station=True), "command", **order) == first
    assert [act.input for act in console.actions] == ["p-1"]
    for _ in range(2):
        [refusal] = say(console, "judge", id="p-2", event=1, answer="target")
        assert (refusal["type"], refusal["id"]) == ("refused", "p-2")
    [refusal] = say(console, "page", id="p-3", event=5)
    assert refusal["id"] == "p-3"
    for number in range(INPUTS_KEPT):
        say(console, "note", id=f"n-{number}", text="x")
    assert len(console.inputs) == INPUTS_KEPT


def test_a_judgement_counts_if_it_was_made_before_the_end() -> None:
    """Though it arrives after it, of an event that is no longer reported; one that was made after it is refused."""
    console = Console(briefing(operator={"task": {"target_share": 0.5}}))
    close(console, 0, report(1, 0), wall_s=10.0)
    close(console, 1, report(1, 1), last=True, wall_s=20.0)
    assert 1 not in console.picture.events
    late = {"event": 1, "answer": "target", "page_s": 100.0}
    assert say(console, "judge", 25.0, **late, sent_s=106.0) == []
    for sent_s in (104.0, 100.0):
        [refusal] = say(console, "judge", 25.0, **late, sent_s=sent_s)
        assert refusal["why"] == "the run is over"
    assert [act.delay_s for act in console.actions] == [6.0]


def test_an_input_is_noted_once_it_is_on_disk(tmp_path: Path) -> None:
    """The answer goes out with the next picture, after the state that a successor would go on from."""
    end, page = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    page.setblocking(False)
    sent: list[Any] = []
    server = ConsoleServer(
        "r", Console(briefing()), tmp_path, Outlet(sent.append, sent.append), Channel(end, lambda _: None)
    )

    def told() -> list[str]:
        kinds = []
        while True:
            try:
                kinds.append(json.loads(page.recv(1 << 20))["type"])
            except BlockingIOError:
                return kinds

    with end, page:
        assert server.on_intent(b'{"type": "note", "text": "x", "id": "p-1", "from": 3}')
        assert told() == []
        with (tmp_path / "actions.csv").open(newline="") as stream:
            assert [(row["text"], row["input"]) for row in csv.DictReader(stream)] == [("x", "p-1")]
        server.show()
        assert told()[0] == "noted"
        server.on_intent(b'{"type": "note", "text": "y", "id": "p-2", "from": 3}')
        server.finish()
        assert "noted" in told()


def test_nobody_is_away_before_the_run_listens() -> None:
    """A page that is shown before the parts of the run are up is no absence since the machine was started."""
    beats = PageBeats()
    assert beats.check(43_000.0) is None
    beats.start(43_001.0)
    assert beats.check(43_002.0) is None
    assert beats.check(43_005.0) == 43_001.0
