"""Inbox policies: nothing is lost, lines stay where they are, memory is bounded, the same items give the same lines."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core import picture as picture_module
from deltaswarm_operator.core.picture import Picture
from deltaswarm_operator.inbox import ledger as ledger_module
from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.ledger import Ledger
from deltaswarm_operator.inbox.policy import urgency
from deltaswarm_scenario.operator_settings import (
    ALERT,
    INFO,
    NOTICE,
    SEVERITIES,
    InboxSettings,
    PersonSettings,
)
from deltaswarm_wire import checked
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import Report
from deltaswarm_wire.plugin_errors import PluginError
from deltaswarm_wire.plugins import INBOX_POLICIES
from tests.support.commanding import reloaded
from tests.support.complaints import mistakes
from tests.support.tiers import in_one_test
from tests.unit.operator.test_simulated_operator import person

POLICIES: tuple[dict[str, Any], ...] = (
    *({"policy": name} for name in INBOX_POLICIES.shipped),
    {"policy": "limited", "per_min": 3, "reserve": 0, "rest": "summed"},
    {"policy": "limited", "per_min": 1, "reserve": 0},
    {"policy": "digest", "every_s": 7.0},
)
PATIENCE_S = 20.0

told = st.tuples(st.integers(0, 4), st.sampled_from(SEVERITIES), st.lists(st.integers(1, 6), max_size=3, unique=True))
streams = st.lists(st.lists(told, max_size=5), max_size=50)
steps_s = st.sampled_from([0.5, 1.0, 2.0])


def inbox(patience_s: float = PATIENCE_S, **table: Any) -> Ledger:
    return Ledger(checked.load(InboxSettings, table), patience_s)


def items_of(stream: Sequence[Sequence[tuple[int, str, list[int]]]], step_s: float) -> list[list[Item]]:
    """Make items by step; an event is fresh where it is first named."""
    known: set[int] = set()
    number, steps = 0, []
    for step, arrived in enumerate(stream):
        items = []
        for agent, severity, events in arrived:
            fresh = tuple(event for event in events if event not in known)
            known.update(events)
            news = "new_event" if fresh else "change"
            told = (agent, "free", 0, tuple(events), bool(fresh), fresh, news, severity)
            items.append(Item(number, step * step_s, *told))
            number += 1
        steps.append(items)
    return steps


def item(number: int, time_s: float, severity: str, events: tuple[int, ...]) -> Item:
    """Make an item that tells nothing new."""
    return Item(number, float(time_s), 0, "free", 0, events, is_new=False, severity=severity)


@pytest.mark.parametrize("table", POLICIES, ids=str)
@given(stream=streams, step_s=steps_s, seed=st.integers(0, 99))
def test_each_item_is_held_back_or_shown_once_and_stays_on_its_line(
    table: dict[str, Any], stream: Any, step_s: float, seed: int
) -> None:
    """Whatever the person opens and reads; why an item was held back is told; a line is named by an item on it."""
    rng, ledger = Random(seed), inbox(**table)
    lines: dict[int, int] = {}
    for step, items in enumerate(items_of(stream, step_s)):
        before = list(ledger.shown)
        shown = ledger.close_step(step * step_s, items)
        assert ledger.shown == [*before, *(item.number for item in shown)]
        if step % 5 == 4:
            ledger.open(rng.sample(range(-1, 200), 20), step * step_s)
        some = {number for number in ledger.shown if rng.random() < 0.2} | {-1, 999}
        unread = some & {*range(len(ledger.items))} - ledger.read_s.keys()
        assert ledger.read([*some, *some], step * step_s) == sorted(unread)
        held = [item.number for item in ledger.held_items]
        assert sorted([*ledger.shown, *held]) == list(range(len(ledger.items)))
        assert held == sorted(held)
        assert ledger.held.items == len(held)
        assert ledger.held.alerts == sum(ledger.items[number].severity == ALERT for number in held)
        for number in ledger.shown:
            item = ledger.items[number]
            assert lines.setdefault(number, item.line) == item.line
            assert item.line in ledger.shown_s
            assert ledger.shown_s[number] >= item.time_s
        assert all(ledger.why_held(number) for number in held)
        asking = {ledger.items[number].line for number in ledger.listed if number not in ledger.read_s}
        assert ledger.unread == len(asking)
    found = ledger.totals(len(stream) * step_s)
    assert found["items"] == found["shown"] + found["never_shown"]
    assert found["alerts_missed"] <= found["alerts"]


@pytest.mark.parametrize("table", POLICIES, ids=str)
@given(stream=streams, step_s=steps_s, cut=st.integers(0, 50))
def test_the_same_items_give_the_same_lines(table: dict[str, Any], stream: Any, step_s: float, cut: int) -> None:
    steps = list(enumerate(items_of(stream, step_s)))
    whole, before = inbox(**table), inbox(**table)
    shown = [whole.close_step(step * step_s, items) for step, items in steps]
    first = [before.close_step(step * step_s, items) for step, items in steps[:cut]]
    after = reloaded(before)
    assert first + [after.close_step(step * step_s, items) for step, items in steps[cut:]] == shown
    assert after.totals(99.0) == whole.totals(99.0)


@pytest.mark.parametrize("table", POLICIES, ids=str)
def test_a_flood_leaves_memory_bounded(table: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 400 items, with room for 50, each event a new one, all others are shown at once and counted."""
    for module in (picture_module, ledger_module):
        monkeypatch.setattr(module, "MAX_INBOX", 50)
    picture, ledger = Picture(1.0), inbox(**table)
    shown: list[Item] = []
    for step in range(100):
        reports = [
            Report(agent, step, step, "free", 0.0, 0.0, 0, (Event(1 + 4 * step + agent, 1.0, 1.0),))
            for agent in range(4)
        ]
        shown += ledger.close_step(float(step), picture.update(reports, float(step)))
        if step == 20:
            size = len(str([value for value in vars(ledger).values() if not hasattr(value, "close_step")]))
    assert (len(ledger.items), picture.items) == (50, 400)
    assert len(ledger.shown) + ledger.held.items == 50
    assert sum(item.number == 50 for item in shown) == 350
    assert len(str([value for value in vars(ledger).values() if not hasattr(value, "close_step")])) < 3 * size


@given(streams, steps_s)
def test_limited_shows_at_most_its_lines_in_any_minute(stream: Any, step_s: float) -> None:
    """The most severe first, and the oldest among them; what is not severe leaves room."""
    for rest in ("waits", "summed"):
        ledger = inbox(policy="limited", per_min=4, reserve=2, rest=rest)
        lines: list[tuple[float, int]] = []
        for step, items in enumerate(items_of(stream, step_s)):
            shown = ledger.close_step(step * step_s, items)
            lines += [(step * step_s, line) for line in dict.fromkeys(item.line for item in shown)]
            if rest == "waits":
                assert shown == sorted(shown, key=urgency)
                waiting = [urgency(item) for item in ledger.held_items]
                asking = [item for item in shown if item.severity != INFO]
                assert not asking or not waiting or urgency(asking[-1]) < min(waiting)
        for at_s, _ in lines:
            within = [line for time_s, line in lines if at_s <= time_s < at_s + 60.0]
            assert len(within) <= 4
            assert sum(all(ledger.items[n].severity == INFO for n in _on(ledger, line)) for line in within) <= 2


def _on(ledger: Ledger, line: int) -> list[int]:
    return [number for number in ledger.shown if ledger.items[number].line == line]


def test_a_digest_comes_at_its_time_and_counts_what_does_not_matter() -> None:
    """One line for all; a line asks to be read for what is above info, or for one item."""
    ledger = inbox(policy="digest", every_s=10.0)
    stream = [[(0, INFO, []), (1, ALERT, [1])], *[[(0, INFO, [])]] * 12, *[[]] * 17]
    shown = {step: ledger.close_step(float(step), items) for step, items in enumerate(items_of(stream, 1.0))}
    assert {step: len(items) for step, items in shown.items() if items} == {10: 12, 20: 2}
    assert [item.number for item in shown[10] if not item.is_quiet] == [1]
    assert {item.line for item in shown[10]} == {1}
    assert [(item.number, item.is_quiet) for item in shown[20]] == [(12, False), (13, True)]


def test_digests_do_not_drift() -> None:
    """In steps of 3 s each comes in the first step that is not before its time, also after a gap."""
    ledger = inbox(policy="digest", every_s=10.0)
    times_s = [*range(0, 63, 3), *range(90, 120, 3)]
    items = [item(number, time_s, INFO, (number,)) for number, time_s in enumerate(times_s)]
    shown = [time_s for time_s, one in zip(times_s, items, strict=True) if ledger.close_step(float(time_s), [one])]
    assert shown == [12, 21, 30, 42, 51, 60, 90, 102, 111]


def test_grouped_has_one_line_for_each_event_or_sender() -> None:
    """Events that one item names first share one; an event that returns has a new one; only news asks to be read."""
    ledger = inbox(policy="grouped")
    stream = [
        [(0, ALERT, [1, 2])],  # 0: line 0
        [(1, INFO, [2]), (2, ALERT, [3])],  # 1: counted on line 0, 2: line 2
        [(3, NOTICE, [])],  # 3: a sender of its own
        [(3, ALERT, []), (4, INFO, [])],  # 4: on line 3, 5: line 5
        [(0, NOTICE, [3])],  # 6: line 2
    ]
    shown = [item for step, items in enumerate(items_of(stream, 1.0)) for item in ledger.close_step(float(step), items)]
    assert [item.line for item in shown] == [0, 0, 2, 3, 3, 5, 2]
    assert [item.number for item in shown if item.is_quiet] == [1]
    again = Item(7, 5.0, 1, "free", 0, (1,), True, (1,), "new_event", ALERT)
    assert [item.line for item in ledger.close_step(5.0, [again])] == [7]


def test_new_holds_back_what_says_nothing_new_and_ranked_ranks() -> None:
    [items] = items_of([[(0, INFO, []), (1, NOTICE, []), (2, ALERT, [])]], 1.0)
    assert [item.number for item in inbox(policy="new").close_step(0.0, items)] == [1, 2]
    for policy in ("all", "ranked"):
        assert [item.line for item in inbox(policy=policy).close_step(0.0, items)] == [0, 1, 2]
    assert [inbox(policy=policy).order for policy in INBOX_POLICIES.shipped].count("ranked") == 1


@given(streams)
def test_what_an_item_tells_follows_the_documented_rule(stream: Any) -> None:
    """A new event before a change of the role, before all else; severities as the scenario says."""
    own = checked.load(InboxSettings, {"repeats": True, "change": NOTICE, "new_event": INFO})
    picture = Picture(1.0, own)
    known: set[int] = set()
    roles: dict[int, tuple[str, set[int]]] = {}
    for step, arrived in enumerate(stream):
        for agent, severity, events in {entry[0]: entry for entry in arrived}.values():
            role = "root" if severity == ALERT else "free"
            seen = tuple(Event(event, 0.0, 0.0) for event in events)
            [item] = picture.update([Report(agent, step, step, role, 0.0, 0.0, 0, seen)], float(step))
            before, named = roles.get(agent, ("", set()))
            expected = "repeat" if role == before and set(events) <= named else "change"
            if role != before:
                expected = "new_root" if role == "root" else "root_lost" if before == "root" else "change"
            if set(item.fresh):
                expected = "new_event"
            if set(events) - known:
                assert item.news == "new_event"
            known.update(events)
            roles[agent] = role, set(events)
            assert item.news == expected
            assert item.severity == getattr(own, item.news)


@in_one_test("step_s", [0.5, 1.0, 2.0])
def test_an_agent_is_unheard_once_until_it_reports_again(step_s: float) -> None:
    """A root that is unheard is lost; by default nobody is missed."""
    picture = Picture(step_s, InboxSettings(unheard_s=10.0))
    quiet = Picture(step_s)
    found: list[tuple[float, int, str, str]] = []
    for step in range(round(60 / step_s)):
        now_s = step * step_s
        said = [Report(agent, step, step, role, 0.0, 0.0, 0, ()) for agent, role in ((1, "root"), (2, "free"))]
        reports = said if now_s in (0.0, 30.0) else []
        assert not quiet.update(reports, now_s) or now_s == 0.0
        found += [(now_s, item.agent, item.news, item.severity) for item in picture.update(reports, now_s)][
            2 if step == 0 else 0 :
        ]
    late_s = 10.0 + step_s
    lost = [(1, "root_lost", ALERT), (2, "unheard", ALERT)]
    assert found == [(at_s, *what) for at_s in (late_s, 30.0 + late_s) for what in lost]


def test_alerts_read_too_late_are_missed_and_times_are_by_event() -> None:
    """An event was shown with the first item that names it; alerts of the last moments count for neither side."""
    ledger = inbox(policy="digest", every_s=10.0, patience_s=15.0)
    for step, items in enumerate(items_of([[(0, ALERT, [1])], *[[]] * 9, [(1, INFO, [1, 2])], *[[]] * 20], 1.0)):
        ledger.close_step(float(step), items)
        if step == 16:
            ledger.read([0], 16.0)
    found = ledger.totals(30.0)
    assert (found["alerts"], found["alerts_missed"], found["alerts_missed_share"]) == (1, 1, 1.0)
    assert (found["alerts_shown_after_s"], found["alerts_read_after_s"]) == (10.0, 16.0)
    assert ledger.by_event({901: 1, 902: 2}) == {"shown_s": {901: 10.0, 902: 10.0}, "read_s": {901: 16.0}}
    early = inbox(policy="all", patience_s=15.0)
    early.close_step(0.0, items_of([[(0, ALERT, [1])]], 1.0)[0])
    assert early.totals(14.0)["alerts_missed_share"] is None


def test_another_patience_changes_nothing_of_what_is_shown() -> None:
    """As in a branch that gives the person more time."""
    ledger = inbox(policy="digest", every_s=10.0, patience_s=15.0)
    for step, items in enumerate(items_of([[(0, ALERT, [1])], *[[]] * 20], 1.0)):
        ledger.close_step(float(step), items)
        if step == 4:
            ledger.go_on_with(None, 50.0)
    assert ledger.totals(20.0)["alerts_missed_share"] is None
    assert ledger.by_event({901: 1})["shown_s"] == {901: 10.0}


def test_the_books_are_what_a_person_counts() -> None:
    """An alert read just in time is not missed, one not yet due is on neither side, an event counts once."""
    ledger = inbox(policy="all", patience_s=15.0)
    alerts_s = {5: 1, 8: 2, 10: 3, 16: 4}
    items = {at_s: item(number, at_s, ALERT, (event,)) for number, (at_s, event) in enumerate(alerts_s.items())}
    items[18] = item(4, 18, INFO, (1,))
    for step in range(30):
        ledger.close_step(float(step), [items[step]] if step in items else [])
        if step in (20, 24):
            ledger.read([{20: 0, 24: 1}[step]], float(step))
    found, later = ledger.totals(30.0), ledger.totals(31.0)
    assert (found["alerts"], found["alerts_missed"], found["alerts_missed_share"]) == (4, 2, pytest.approx(2 / 3))
    assert (later["alerts_missed"], later["alerts_missed_share"]) == (3, 0.75)
    assert (found["alerts_never_shown"], found["shown_after_s"], found["alerts_read_after_s"]) == (0, 0.0, 15.5)
    assert ledger.by_event({901: 1, 903: 3}) == {"shown_s": {901: 5.0, 903: 10.0}, "read_s": {901: 20.0}}
    assert [ledger.waiting(before_s) for before_s in (10.0, 10.5, 20.0)] == [0, 1, 3]


def test_an_item_that_the_person_opened_at_once_was_held_back() -> None:
    """The person asked for it; the policy did not show it."""
    ledger = inbox(policy="digest")
    ledger.close_step(3.0, [item(0, 3, INFO, (1,))])
    ledger.open([0], 3.0)
    assert (ledger.totals(3.0)["shown"], ledger.totals(3.0)["held_back"]) == (1, 1)
    assert ledger.why_held(0)


@in_one_test(
    ("table", "wrong"),
    [
        ({"policy": "grupped"}, "policy"),
        ({"policy": "limited", "per_minute": 5}, "per_minute"),
        ({"policy": "limited", "per_min": 0}, "per_min"),
        ({"policy": "limited", "per_min": 3, "reserve": 3}, "reserve"),
        ({"policy": "all", "every_s": 5.0}, "every_s"),
        ({"policy": "digest", "every_s": "often"}, "every_s"),
        ({"policy": "no_such_module:Policy"}, "policy"),
        ({"policy": "deltaswarm_operator.inbox.policy:Put"}, "policy"),
        ({"new_event": "urgent"}, "new_event"),
    ],
)
def test_a_wrong_key_is_named(table: dict[str, Any], wrong: str) -> None:
    assert [path for path, _ in mistakes({"operator": {"inbox": table}})] == [f"operator.inbox.{wrong}"]


@in_one_test(
    ("body", "said"),
    [
        ("return [Put(99, (99,))]", "must return Puts of items 0 to 0"),
        ("return [(0, (0,))]", "must return Puts of items 0 to 0"),
        ("return [Put(0, (True,))]", "must return Puts of items 0 to 0"),
        ("return None", "failed: TypeError"),
        ("return [Put(0, 0)]", "must return Puts of items 0 to 0"),
        ("raise OSError('no')", "failed: OSError: no"),
        ("yield 1 / 0", "failed: ZeroDivisionError"),
    ],
)
def test_what_a_policy_does_wrong_is_told_in_one_line(body: str, said: str, tmp_path: Path, monkeypatch: Any) -> None:
    """With its name; an item that it forgets or shows twice is no mistake."""
    name = f"own_policy_{abs(hash(body))}"
    (tmp_path / f"{name}.py").write_text(
        "from deltaswarm_operator.inbox.policy import Put\n"
        "from deltaswarm_wire.plugins import NoSettings\n"
        "class Own:\n"
        "    Settings, ORDER, HELD = NoSettings, 'newest', 'because'\n"
        "    def __init__(self, settings): pass\n"
        f"    def close_step(self, now_s, items):\n        {body}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    ledger = inbox(policy=f"{name}:Own")
    with pytest.raises(PluginError, match=said) as caught:
        ledger.close_step(0.0, items_of([[(0, INFO, [])]], 1.0)[0])
    assert str(caught.value).startswith(f"{name}:Own.close_step ")
    assert f"({tmp_path / name}.py:" in str(caught.value)
    assert os.linesep not in str(caught.value)


def test_a_simulated_person_reads_lines_at_their_price() -> None:
    """What a line only counts costs nothing; each further item that asks costs `more_s`; a list is read as listed."""
    settings = PersonSettings(policy="none", sigma=0.0, slowing=0.0, known_s=1.0, new_s=4.0, more_s=0.5)

    def reads(*items: Item, one: Any) -> list[tuple[int, tuple[int, ...]]]:
        found = []
        for step in range(30):
            found += [(step, act.numbers) for act in one.live(float(step), items if step == 0 else (), 0.0)]
        return found

    def item(number: int, severity: str = INFO, line: int = -1, *, new: bool = False, quiet: bool = False) -> Item:
        return Item(number, 0.0, number, "free", 0, (number,), new, (), "change", severity, line, quiet)

    line = (item(0, line=0, new=True), item(1, line=0), item(2, line=0), item(3, line=0, quiet=True))
    assert reads(*line, one=person(settings)) == [(5, (0, 1, 2, 3))]
    mixed = (item(0), item(1, new=True), item(2, ALERT))
    assert [numbers for _, numbers in reads(*mixed, one=person(settings))] == [(1,), (0,), (2,)]
    listed = checked.load(PersonSettings, {**checked.plain(settings), "reads": "listed"})
    assert [numbers for _, numbers in reads(*mixed, one=person(listed))] == [(0,), (1,), (2,)]
    ranked = person(listed)
    ranked.is_ranked = True
    assert [numbers for _, numbers in reads(*mixed, one=ranked)] == [(2,), (0,), (1,)]


def test_the_example_of_the_guide_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In docs/EXTENDING.md: alerts at once, the rest after a quiet time."""
    page = (Path(__file__).parents[3] / "docs" / "EXTENDING.md").read_text()
    [code] = re.findall(r"```python\n# patient.py\n(.*?)```", page, re.DOTALL)
    (tmp_path / "patient.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    ledger = inbox(policy="patient:Patient", quiet_s=5.0)
    stream = [[], [(0, ALERT, [1]), (1, INFO, [])], *[[]] * 8]
    shown = {step: ledger.close_step(float(step), items) for step, items in enumerate(items_of(stream, 1.0))}
    assert {step: [item.number for item in items] for step, items in shown.items() if items} == {1: [0], 6: [1]}
    assert ledger.why_held(1) == "waits for a quiet minute"
