"""What one participant does: orders and streams are balanced, and each run has its scenario."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_sessions.plan import MAX_SEED, Placed, group_of, order_of, order_warning, outline_text, plan, square
from deltaswarm_sessions.settings import load_session
from deltaswarm_wire.checked import SettingsError
from tests.support.sessions import FORMS, a_file, a_session, with_criterion
from tests.support.tiers import in_one_test

counts = st.integers(1, 12)
seeds = st.none() | st.integers(0, 2**40)


@given(counts)
def test_each_row_has_every_condition_once(count: int) -> None:
    """Whoever takes part does each once."""
    rows = square(count)
    assert len(rows) == (count if count % 2 == 0 else 2 * count)
    assert all(sorted(row) == list(range(count)) for row in rows)


@given(counts)
def test_places_and_successions_are_balanced(count: int) -> None:
    """Each condition comes equally often at each place, and equally often right after each other one."""
    rows = square(count)
    places = Counter((place, condition) for row in rows for place, condition in enumerate(row))
    assert set(places.values()) == {len(rows) // count}
    pairs = Counter(pair for row in rows for pair in pairwise(row))
    assert len(pairs) == count * (count - 1)
    assert set(pairs.values()) <= {1 if count % 2 == 0 else 2}


@given(st.integers(0, 40), counts, seeds)
def test_each_pass_takes_every_row_once(cycle: int, count: int, seed: int | None) -> None:
    """In turn, or in an order drawn from the seed; the same participant has always the same."""
    rows = square(count)
    first = cycle * len(rows) + 1
    orders = [order_of(participant, count, seed) for participant in range(first, first + len(rows))]
    conditions = [[condition for condition, _ in order] for order in orders]
    assert sorted(conditions) == sorted(rows)
    assert orders[0] == order_of(first, count, seed)
    if seed is None:
        assert conditions == rows


@given(st.integers(2, 8), st.integers(6, 48), seeds)
def test_streams_conditions_and_places_are_balanced(count: int, participants: int, seed: int | None) -> None:
    """Any two of the three: equally often after two passes, and never far from it; nobody meets a stream twice."""
    done = [order_of(participant, count, seed) for participant in range(1, participants + 1)]
    assert all(sorted(stream for _, stream in order) == list(range(count)) for order in done)
    cells: list[Counter[tuple[int, int]]] = [Counter(), Counter(), Counter()]
    for order in done:
        for place, (condition, stream) in enumerate(order):
            for counter, pair in zip(cells, ((condition, stream), (place, stream), (place, condition)), strict=True):
                counter[pair] += 1
    rows = len(square(count))
    for counter in cells:
        times = [counter[first, second] for first in range(count) for second in range(count)]
        if participants % (2 * rows) == 0:
            assert len(set(times)) == 1
        assert max(times) - min(times) <= 2 * rows // count


def test_rows_and_orders_are_the_published_ones() -> None:
    """Sessions that have begun go on with them."""
    assert square(1) == [[0], [0]]
    assert square(3) == [[0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0], [0, 2, 1], [1, 0, 2]]
    assert square(4) == [[0, 1, 3, 2], [1, 2, 0, 3], [2, 3, 1, 0], [3, 0, 2, 1]]
    assert [order_of(who, 2) for who in (1, 2, 3, 4, 5)] == [
        [Placed(0, 0), Placed(1, 1)],
        [Placed(1, 0), Placed(0, 1)],
        [Placed(0, 1), Placed(1, 0)],
        [Placed(1, 1), Placed(0, 0)],
        [Placed(0, 0), Placed(1, 1)],
    ]
    assert [order_of(who, 3, seed=5) for who in (1, 2, 7, 8)] == [
        [Placed(0, 1), Placed(2, 0), Placed(1, 2)],
        [Placed(1, 0), Placed(0, 2), Placed(2, 1)],
        [Placed(2, 0), Placed(1, 2), Placed(0, 1)],
        [Placed(1, 0), Placed(2, 1), Placed(0, 2)],
    ]
    assert len({tuple(order_of(1, 4, seed)) for seed in range(40)}) == 4


@in_one_test(("count", "is_crossed", "group"), [(2, True, 4), (3, True, 12), (2, False, 2), (3, False, 6)])
def test_participants_come_in_groups_that_balance_the_design(count: int, is_crossed: bool, group: int) -> None:
    """As the page on sessions says."""
    assert group_of(count, is_crossed=is_crossed) == group


def test_the_runs_of_a_participant_are_the_published_ones(tmp_path: Path) -> None:
    """Folders, streams and seeds; the page says what comes next, and the sheet is prefilled."""
    settings, beside = load_session(str(a_file(tmp_path, 3, FORMS)))
    runs = plan(settings, 7, beside)
    assert [(run.folder, run.position, run.stream, run.seeds, run.scenario.seed, *run.set) for run in runs] == [
        ("0-training", 0, None, (1, 0), 2768865746696951, "run.duration_s=60"),
        ("1-C", 1, 0, (1, 1), 558549749402523, "control.delta=4"),
        ("2-B", 2, 2, (1, 3), 5424549404331930, "control.delta=3"),
        ("3-A", 3, 1, (1, 2), 8523537593329939, "control.delta=2"),
    ]
    assert [runs[0].attempt(number).seed for number in (1, 2, 3)] == [
        2768865746696951,
        6451275259874307,
        8544983638708541,
    ]
    assert runs[1].attempt(2).seed == 3444332874037685
    more = "Please wait: the next run follows by itself."
    pages = [run.scenario.operator.page for run in runs]
    assert [page.title for page in pages] == ["training", "C", "B", "A"]
    assert [page.end_text for page in pages] == [more, more, more, "Thank you: that was the last run."]
    assert {(page.pace, page.language.tag) for page in pages} == {(False, "")}
    sheets = [run.scenario.operator.probes for run in runs]
    assert [sheet.condition for sheet in sheets] == ["0 training", "1 C", "2 B", "3 A"]
    assert {(sheet.participant, sheet.isa_jitter_s) for sheet in sheets} == {("P007", 30.0)}
    assert [sheet.consent[:12] for sheet in sheets] == ["You may stop", "", "", ""]
    assert [(run.once, run.criterion) for run in runs] == [(("you",), None), *[((), None)] * 3]
    assert [(run.label, run.stream, run.scenario.seed) for run in plan(settings, 8, beside)] == [
        ("training", None, 2768865746696951),
        ("A", 2, 5424549404331930),
        ("C", 1, 8523537593329939),
        ("B", 0, 558549749402523),
    ]


def test_arrivals_may_be_new_in_each_run(tmp_path: Path) -> None:
    """Of all participants: only the training's are the same."""
    settings, beside = load_session(str(a_file(tmp_path)))
    runs = plan(replace(settings, language="de", arrivals="own", allocation="in turn"), 2, beside)
    assert [(run.label, run.stream, run.seeds, run.scenario.seed) for run in runs] == [
        ("training", None, (1, 0), 2768865746696951),
        ("B", None, (1, 103), 2886970974471098),
        ("C", None, (1, 104), 4142690500201270),
        ("A", None, (1, 105), 3004444965648156),
    ]
    assert {run.scenario.operator.page.language.tag for run in runs} == {"de"}


def test_each_group_of_participants_gets_the_next_set_of_streams(tmp_path: Path) -> None:
    """Balanced within a group, with other arrivals in each set; after the last set comes the first again."""
    settings, beside = load_session(str(a_file(tmp_path, 2)))
    in_sets = replace(settings, arrival_sets=3)
    runs = [plan(in_sets, participant, beside)[1:] for participant in range(1, 17)]
    groups = [runs[at : at + 4] for at in range(0, 16, 4)]
    streams = [{run.stream for planned in group for run in planned} for group in groups]
    assert streams == [{0, 1}, {2, 3}, {4, 5}, {0, 1}]
    for group in groups:
        pairs = Counter((run.label, run.stream) for planned in group for run in planned)
        assert set(pairs.values()) == {2}
    seeds = {(run.stream, run.scenario.seed) for planned in runs for run in planned}
    assert len(seeds) == len({seed for _, seed in seeds}) == 6
    first = [(run.stream, run.scenario.seed) for run in plan(settings, 1, beside)]
    assert first == [(run.stream, run.scenario.seed) for run in plan(in_sets, 1, beside)]


def test_seeds_of_repeated_runs_differ_and_are_numbers_that_all_programs_read(tmp_path: Path) -> None:
    """Of the training and of three conditions, three times."""
    repeated = {run.attempt(number).seed for run in a_session(tmp_path, 3).runs for number in (1, 2, 3)}
    assert len(repeated) == 12
    assert max(repeated) < MAX_SEED == 9007199254740992


def test_a_repeated_training_asks_nothing_twice(tmp_path: Path) -> None:
    """Neither consent nor the forms before the session; after one that was cut off, all is asked again."""
    session = a_session(tmp_path, 2, FORMS + with_criterion(more='if_not_reached = "end"'))
    training = session.runs[0]
    asked = [
        (probes.consent[:12], [form.name for form in probes.form])
        for probes in (training.attempt(n, is_repeat=r).operator.probes for n, r in ((1, False), (2, False), (3, True)))
    ]
    assert asked == [("You may stop", ["you"]), ("You may stop", ["you"]), ("", [])]
    assert training.scenario.operator.page.end_text == "Please wait."
    assert [run.criterion is None for run in session.runs] == [False, True, True]
    goes_on = a_session(tmp_path, 1, with_criterion()).runs[0]
    assert goes_on.scenario.operator.page.end_text == "Please wait: the next run follows by itself."


def test_forms_come_before_between_and_after_the_runs(tmp_path: Path) -> None:
    """Each run has those that belong to it; two of one name, or a wrong question, are refused before anything runs."""
    forms = [
        [(form.name, form.when) for form in run.scenario.operator.probes.form]
        for run in a_session(tmp_path, 2, FORMS).runs
    ]
    assert forms == [[("you", "before")], [("trust", "after")], [("trust", "after"), ("end", "after")]]
    for wrong, path in (
        (FORMS.replace('"trust"', '"you"'), "session.form"),
        (FORMS.replace("high = 99", "high = 9"), "session.form[0].question[0].high"),
        (FORMS.replace('name = "why"', 'name = "reliable"'), "session.form[1].question"),
        (FORMS.replace('"you"', '"tlx"'), "form"),
    ):
        with pytest.raises(SettingsError) as told:
            a_session(tmp_path, 2, wrong)
        assert path in [problem.path for problem in told.value.problems]


def test_paths_start_at_the_sessions_file(tmp_path: Path) -> None:
    """Of scenarios and of the text of consent, which must be a text."""
    file = a_file(tmp_path, 1)
    (tmp_path / "own.toml").write_text('schema = 1\nname = "own"\n')
    text = file.read_text().replace('label = "A"', 'label = "two words"')
    file.write_text(text.replace('scenario = "smoke"', 'scenario = "own.toml"'))
    settings, beside = load_session(str(file))
    assert beside == tmp_path
    runs = plan(settings, 1, beside)
    assert [(run.scenario.name, run.folder) for run in runs] == [("own", "0-training"), ("own", "1-two-words")]
    (tmp_path / "consent.txt").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(SettingsError, match=r"session.consent must be a text file.*'consent.txt'"):
        plan(settings, 1, beside)
    strange = "Dürfen wir? \U0001f642\n\n\"\x7f\\\" ''' = #"
    (tmp_path / "consent.txt").write_text(strange)
    assert plan(settings, 1, beside)[0].scenario.operator.probes.consent == strange
    (tmp_path / "consent.txt").write_bytes(b"\xef\xbb\xbfYes?")
    for consent, shown in (("consent.txt", "Yes?"), ("", "")):
        assert plan(replace(settings, consent=consent), 1, beside)[0].scenario.operator.probes.consent == shown


def condition(label: str) -> str:
    return f'[[session.condition]]\nlabel = "{label}"\n'


@pytest.mark.parametrize(
    ("text", "path", "given"),
    [
        ("", "session", "missing"),
        ("[session]\n", "session.condition", "0"),
        ("".join(map(condition, map(str, range(51)))), "session.condition", "51"),
        (condition("A") * 2, "session.condition", "training, A, A"),
        (condition("training"), "session.condition", "training, training"),
        *(
            (condition(label), "session.condition[0].label", repr(label))
            for label in ("a/b", "", "a ", ".a", "a\u200b", "..", "x" * 101)
        ),
        (FORMS.replace('"end"', '"you"') + condition("A"), "session.form", "you, trust, you"),
        ('[session]\narrivals = "own"\narrival_sets = 2\n' + condition("A"), "session.arrival_sets", "2"),
    ],
)
def test_a_wrong_file_is_told_by_name(tmp_path: Path, text: str, path: str, given: str) -> None:
    """Before a participant sits there."""
    (tmp_path / "session.toml").write_text(f"schema = 1\n{text}")
    with pytest.raises(SettingsError) as told:
        load_session(str(tmp_path / "session.toml"))
    assert [(problem.path, problem.given) for problem in told.value.problems] == [(path, given)]


def test_fifty_conditions_are_allowed(tmp_path: Path) -> None:
    """And one."""
    for count in (1, 50):
        (tmp_path / "session.toml").write_text("schema = 1\n" + "".join(map(condition, map(str, range(count)))))
        assert len(load_session(str(tmp_path / "session.toml"))[0].condition) == count


@in_one_test(("orders", "warns"), [("[]", True), ("['set delta']", True), ("['none']", False), ("['recall']", False)])
def test_an_order_that_undoes_a_condition_is_warned_of(orders: str, warns: bool, tmp_path: Path) -> None:
    """Its field shows what the conditions vary, and it changes it. The training's own value does not count."""
    file = a_file(tmp_path, 2)
    file.write_text(file.read_text().replace('["control', f'["operator.page.orders={orders}", "control'))
    settings, beside = load_session(str(file))
    runs = plan(settings, 1, beside)
    said = order_warning(runs)
    assert (said is not None) == warns
    assert said is None or "vary delta, which the participant reads and can change in the order 'set delta'" in said
    assert order_warning(runs[:2]) is None


def test_the_outline_reads_as_lines() -> None:
    """A line for each thing that a session has, and none for what it does not have."""
    row = {"label": "A", "scenario": "smoke", "simulated_s": 90.0, "wall_min": 1.5, "asks": ["ISA every 60 s", "SAGAT"]}
    whole = {"runs": [row], "is_order_concealed": True, "forms": {"trust": "after"}, "training_runs_at_most": 2}
    whole |= {"group": 4, "streams": 6}
    head, first, *lines = outline_text({**whole, "wall_min": 1.5}).splitlines()
    assert first.split() == ["A", "smoke", "90", "1.5", "ISA", "every", "60", "s;", "SAGAT"]
    starts = ["run", "The", "Forms", "Training:", "Recruit", "Streams", "All"]
    assert [line.split()[0] for line in (head, *lines[1:])] == starts
    for line, text in zip(lines[2:6], ("trust (after)", "most 2 runs", "groups of 4,", "n = 6 per"), strict=True):
        assert text in line
    bare = {**whole, "is_order_concealed": False, "forms": {}, "training_runs_at_most": 1, "streams": None}
    _, first, *rest = outline_text({**bare, "wall_min": None, "runs": [{**row, "wall_min": None}]}).splitlines()
    assert "as fast as possible" in first
    assert [line.split()[0] for line in rest if line] == ["Recruit"]
