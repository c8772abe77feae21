"""Study files: those that come with deltaswarm are sound, and mistakes are told by name before anything runs."""

import re
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.sweeps.load import built_in_files
from deltaswarm_orchestrator.sweeps.table import write_table
from deltaswarm_studies.load import COLLECTIONS, expanded
from deltaswarm_studies.plan import plan, text
from deltaswarm_studies.stats import pairs_needed
from deltaswarm_studies.study import default_factors
from deltaswarm_studies.tables import runs_of
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import LEVELS, OWN, SWEEP, built_in, made, spread, table
from tests.support.tiers import in_one_test


@in_one_test("name", built_in_files())
def test_every_built_in_file_is_a_study_that_can_show_what_it_asks(name: str) -> None:
    """Enough replicates for its contrasts; every figure has a caption. A bare sweep is a study that asks nothing."""
    study = built_in(name)
    assert study.name == name
    assert len(set(default_factors(study.sweep))) == len(study.sweep.factors)
    for contrast in study.file.contrast:
        assert study.repeats >= pairs_needed(len(list(study.comparisons(contrast)))), contrast.id
        assert contrast.text
    assert all(figure.caption for figure in study.file.figure)
    asks = study.file.figure or study.file.grid or study.file.fit or study.ranges
    assert asks or name not in COLLECTIONS["all"]


def test_the_plan_says_what_so_many_replicates_could_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before hours are spent: six replicates can show nothing under Holm over fourteen comparisons."""
    monkeypatch.setattr("deltaswarm_studies.plan.MEASURED_S", 0.0)
    losses = [place / 10 for place in range(8)]
    file = tmp_path / "own.toml"
    file.write_text(SWEEP.replace("[0.0, 0.5, 0.9]", str(losses)) + OWN + CONTRAST)
    command = ["study", str(file), "--out", str(tmp_path / "out"), "--plan"]
    assert main([*command, "--repeats", "6"]) == 0
    told = capsys.readouterr().out
    assert "10 replicates are needed" in told
    assert "cores" in told
    assert main([*command, "--repeats", "10"]) == 0
    assert "needed" not in capsys.readouterr().out


def test_with_a_pilot_the_plan_says_which_effect_it_could_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The smaller the spread and the more replicates, the smaller the effect; on the contrast's scale."""
    monkeypatch.setattr("deltaswarm_studies.plan.MEASURED_S", 0.0)

    def effect(noise: float, repeats: int) -> float:
        def value(level: str, mode: str, replicate: int) -> float:
            return spread(level, mode, replicate) * (1 + noise) ** ((replicate * 7 + LEVELS.index(level)) % 5)

        study = made(OWN + CONTRAST, SWEEP.replace("repeats = 10", f"repeats = {repeats}"))
        write_table(tmp_path / "runs", runs_of(study, table(value), pd.DataFrame()))
        (line,) = [line for line in text(plan(study, tmp_path, 2)).splitlines() if "waiting_all" in line]
        return float(re.findall(r"shows (\S+) times", line)[0])

    assert 1 < effect(0.02, 40) < effect(0.02, 20) < effect(0.2, 20)


SWARM = '[[figure]]\nname = "f"\nkind = "swarm"\nat_s = 1500.0\n'
TIMES_BY_LOSS = (
    OWN + '[[figure]]\nname = "f"\nkind = "time"\nmetric = "trees"\nhue = "mode"\nfacet = "loss"\n'
    'spans = [{ text = "lost", from_s = 300.0, '
)
DRAWN = '[[figure]]\nname = "f"\nkind = "time"\nmetric = "trees"\n'
TIMED = OWN.replace("window_s", "from_s = 500.0\nwindow_s").replace('"waiting_all"', '"trees"')
CONTRAST = '[[contrast]]\nid = "a"\nfactor = "loss"\nreference = "loss=0.0"\n'
CLAIM = '[[claim]]\nid = "a"\ntext = "t"\nless = "loss=0.0, hybrid 3"\nmore = "loss=0.5, hybrid 3"\n'
FINDING = '[[finding]]\nheading = "t"\nresults = [{ contrast = "a", metric = "messages", level = "loss=0.5", '
FINDING += 'within = "hybrid 3" }]\n'


def test_sound_tables_are_taken() -> None:
    assert made(OWN + CONTRAST + CLAIM + FINDING)
    assert made(TIMED)


@in_one_test(
    ("own", "path"),
    [
        (CONTRAST + CLAIM + CLAIM, "claim.id"),
        (CONTRAST + CONTRAST, "contrast.id"),
        (CONTRAST + FINDING.replace("loss=0.5", "loss=0.6"), "finding[0].results[0].level"),
        (CONTRAST + FINDING.replace("loss=0.5", "loss=0.0"), "finding[0].results[0].level"),
        (CONTRAST + FINDING.replace('"messages"', '"mesages"'), "finding[0].results[0].metric"),
        (CONTRAST + FINDING.replace('"messages"', '"trees"'), "finding[0].results[0].metric"),
        (CONTRAST + FINDING.replace("hybrid 3", "hybrid"), "finding[0].results[0].within"),
        (CONTRAST + FINDING.replace('"loss=0.5"', '["loss=0.5", "loss=0.6"]'), "finding[0].results[0].level"),
        (CONTRAST + FINDING.replace('"a"', '["a"]').replace("loss=0.5", "loss=0.6"), "finding[0].results[0].level"),
        (CONTRAST + FINDING.replace("within", "whitin"), "finding[0].results[0].whitin"),
        (CONTRAST + FINDING.replace('contrast = "a"', 'contrast = "b"'), "finding[0].results[0].contrast"),
        (CONTRAST + FINDING.replace('contrast = "a", ', ""), "finding[0].results[0]"),
        ('[[finding]]\nheading = "t"\n', "finding[0].results"),
        ('[[finding]]\nheading = "t"\nresults = []\n', "finding[0].results"),
        (CONTRAST + "margin = 0.9\n", "contrast[0].margin"),
        (CONTRAST + "margin = 1.0\n", "contrast[0].margin"),
        (CONTRAST.replace('reference = "loss=0.0"', 'pairs = [["loss=0.0"]]'), "contrast[0].pairs[0]"),
        (CONTRAST.replace('reference = "loss=0.0"', 'pairs = [["loss=0.5", "loss=0.5"]]'), "contrast[0].pairs[0]"),
        (CONTRAST.replace('reference = "loss=0.0"\n', ""), "contrast[0].reference"),
        (CONTRAST + 'across = "mode"\n', "contrast[0].across_pairs"),
        (CONTRAST + 'across_pairs = [["hybrid 3", "decentralised"]]\n', "contrast[0].across"),
        (CONTRAST + 'across = "loss"\nacross_pairs = [["loss=0.5", "loss=0.9"]]\n', "contrast[0].across"),
        (CLAIM.replace("loss=0.5", "loss=0.0"), "claim[0].more"),
        (CLAIM + 'reference = "loss=0.0, hybrid 3"\n', "claim[0].reference"),
        (CLAIM + 'kind = "trend"\nalong = ["loss=0.0, hybrid 3", "loss=0.5, hybrid 3"]\n', "claim[0].along"),
        (OWN + '[study.words]\n"loss=0.6" = "with loss"\n', "study.words"),
        (CLAIM + 'kind = "value"\nof = "loss=0.0, hybrid 3"\nwithin = [1.0, 2.0]\nabove = 1.0\n', "claim[0].within"),
        (CLAIM + 'kind = "value"\nof = "loss=0.0, hybrid 3"\nwithin = [1.0, 2.0]\niqr = 1.0\n', "claim[0].iqr"),
        (OWN.replace("window_s = 100.0", "window_s = 150.0") + DRAWN, "study.window_s"),
        (TIMED.replace("500.0", "550.0"), "study.from_s"),
        (TIMED.replace("500.0", "1000.0"), "study.from_s"),
        (TIMED.replace("window_s", "until_s = 500.0\nwindow_s"), "study.until_s"),
        (OWN + '[[figure]]\nname = "f"\nx = "mode"\nmetric = "w"\n', "figure[0].metric"),
        (OWN + '[[figure]]\nname = "f"\nx = "mode"\nmetric = "person_load"\n', "metric 'person_load'"),
        (SWARM.replace("1500", "1000"), "figure[0].at_s"),
        (TIMED.replace("window_s", "until_s = 300.0\nwindow_s"), "study.until_s"),
        (TIMED.replace('"trees"', '"waiting"'), "study.from_s"),
        (OWN + '[[metric]]\nname = "w"\nkind = "window"\nof = "trees"\nfrom_s = 130.0\n', "metric[0].from_s"),
        ('[[metric]]\nname = "waiting"\ncolumn = "steps"\n', "metric.name"),
        (OWN.replace('"waiting_all"', '"person_load"'), "metric 'person_load'"),
        (OWN.replace('"waiting_all"', '"w"') + '[[metric]]\nname = "w"\ncolumn = "trees.maen"\n', "metric 'w'"),
        ('[[recovery]]\nmetric = "trees"\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\nafter_s = 1e4\n',
         "recovery[0].after_s"),
        ('[[recovery]]\nmetric = "waiting"\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\n',
         "recovery[0].metric"),
        ('[[figure]]\nname = "f"\nx = "mode"\npublished = { "hybrid 4" = [1, 2] }\n', "figure[0].published"),
        ('[[figure]]\nname = "f"\nx = "mode"\npublished = { "hybrid 3" = 1 }\n', "figure[0].published.hybrid 3"),
        ('[[figure]]\nname = "f"\nx = "mode"\nlines = { here = "there" }\n', "figure[0].lines"),
        ('[[figure]]\nname = "f"\nx = "mode"\nlines = { here = [1] }\n', "figure[0].lines.here"),
        ('[[fit]]\nfactor = "mode"\n', "fit[0].targets"),
        ('[[fit]]\nfactor = "mod"\ntargets = [{ level = "hybrid 3", metric = "waiting" }]\n', "fit[0].factor"),
        ('[[fit]]\nfactor = "mode"\ntargets = [{ level = "hybrid 4", metric = "waiting" }]\n', "fit[0].targets"),
        ('[[fit]]\nfactor = "mode"\ntargets = [{ level = "hybrid 3", metric = "w" }]\n', "fit[0].targets"),
        ('[[grid]]\nrows = "loss"\nfactor = "mode"\n', "grid[0].columns"),
        ('[[grid]]\nrows = "loss"\nfactor = "mode"\ncolumns = { a = "hybrid 3" }\n', "grid[0].columns.a"),
        ('[[grid]]\nrows = "loss"\nfactor = "mode"\ncolumns = { a = ["hybrid 4"] }\n', "grid[0].columns"),
        ('[[grid]]\nrows = "los"\nfactor = "mode"\ncolumns = { a = ["hybrid 3"] }\n', "grid[0]"),
        ('[[figure]]\nname = "f"\nkind = "frontier"\nx = "messages"\n', "figure[0].paths"),
        ('[[figure]]\nname = "f"\nkind = "frontier"\nx = "messages"\npaths = { a = ["b"] }\n', "figure[0].variants"),
        ('[[figure]]\nname = "f"\nx = "mode"\n[[figure]]\nname = "f"\nx = "mode"\n', "figure.name"),
        ('[[contrast]]\nid = "a"\nfactor = "los"\nreference = "loss=0.0"\n', "contrast[0].factor"),
        ('[[contrast]]\nid = "a"\nfactor = "loss"\nreference = "0.0"\n', "contrast[0].reference"),
        ('[[contrast]]\nid = "a"\nfactor = "loss"\nreference = "loss=0.0"\nmetrics = ["w"]\n', "contrast[0].metrics"),
        ('[[claim]]\nid = "a"\ntext = "t"\nless = "x"\nmore = "loss=0.0, hybrid 3"\n', "claim[0] (a)"),
        ('[[claim]]\nid = "a"\ntext = "t"\nkind = "value"\nof = "loss=0.0, hybrid 3"\n', "claim[0].within"),
        ('[[claim]]\nid = "a"\ntext = "t"\nkind = "alike"\na = "b"\nb = "c"\nmargin = 0.9\n', "claim[0].margin"),
        ('[[recovery]]\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "no loss"\n', "recovery[0].level"),
        ('[[figure]]\nname = "f"\nkind = "boxes"\nx = "modes"\n', "figure[0].x"),
        ('[[figure]]\nname = "f"\nkind = "pie"\n', "figure[0].kind"),
        ('[[figure]]\nname = "f"\nx = "mode"\npath = ["loss=0.0, hybrid 3"]\n', "figure[0].path"),
        ('[[figure]]\nname = "f"\nx = "mode"\nspans = [{ text = "t", from_s = 1.0 }]\n', "figure[0].spans"),
        ('[[figure]]\nname = "f"\nkind = "levels"\nx = "mode"\npublished = { hybrid = [1, 2] }\n',
         "figure[0].published"),
        ('[[figure]]\nname = "f"\nkind = "time"\nx = "mode"\n', "figure[0].x"),
        ('[[figure]]\nname = "f"\nkind = "swarm"\nlines = { a = 1.0 }\n', "figure[0].lines"),
        (
            '[[figure]]\nname = "f"\nx = "mode"\nfacet = "loss"\npublished = { "hybrid 3" = [1, 2] }\n',
            "figure[0].published",
        ),
        (
            '[[figure]]\nname = "f"\nx = "mode"\nvariants = ["loss=0.0, decentralised"]\n'
            'published = { "hybrid 3" = [1, 2] }\n',
            "figure[0].published",
        ),
        (
            '[[figure]]\nname = "f"\nkind = "plane"\nx = "messages"\nhue = "mode"\n'
            'variants = ["loss=0.0, decentralised"]\npath = ["loss=0.0, hybrid 3"]\n',
            "figure[0].path",
        ),
        (TIMES_BY_LOSS + 'levels = ["no loss"] }]\n', "figure[0].spans[0].levels"),
        ('[[figure]]\nname = "f"\nkind = "plane"\nx = "mode"\nhue = "mode"\n', "figure[0].x"),
        ('[[figure]]\nname = "f"\nkind = "plane"\nx = "messages"\n', "figure[0].hue"),
        ('[[figure]]\nname = "f"\nkind = "boxes"\nhue = "mode"\n', "figure[0].x"),
        ('[[figure]]\nname = "f"\nkind = "levels"\n', "figure[0].x"),
        ('[[figure]]\nname = "f"\nkind = "frontier"\npaths = {a = ["loss=0.0, hybrid"]}\n', "figure[0].x"),
        ('[[figure]]\nname = "f"\nkind = "time"\nmetric = "trees"\nhue = "mode"\n', "figure[0].hue"),
        ('[[finding]]\nheading = "t"\nresults = [{ claim = "none" }]\n', "finding[0].results[0].claim"),
        (
            '[[fit]]\ntext = "f"\nfactor = "mode"\ntargets = [{ level = "hybrid 3", metric = "waiting" }]\n'
            '[[finding]]\nheading = "t"\nresults = [{ fit = "f", within = "loss=0.6" }]\n',
            "finding[0].results[0].within",
        ),
        ('[[finding]]\nheading = "t"\nresults = [{ fit = "none" }]\n', "finding[0].results[0].fit"),
        ('[[metric]]\nname = "m"\nkind = "window"\nof = "waiting"\n', "metric[0].of"),
        ('[[metric]]\nname = "m"\n', "metric[0].column"),
        ("[study]\nfactors = { loss = \"one\" }\n", "study.factors"),
        ("[study]\ntitel = \"t\"\n", "study.titel"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_by_name(own: str, path: str) -> None:
    with pytest.raises(SettingsError) as caught:
        made(own if own.lstrip().startswith("[study]") else OWN + own)
    assert path in [problem.path for problem in caught.value.problems]


STEPS = SWEEP.replace("[sweep.axes]\nradio.loss = [0.0, 0.5, 0.9]", "[sweep.axes]\nrun.step_s = [0.5, 1.0, 2.0]")
BY_STEP = OWN.replace("loss =", "step =").replace('"messages"', '"waiting"')


@in_one_test(
    ("metric", "steps_s", "is_refused"),
    [
        ("waiting_all", "0.5, 1.0, 2.0", False),
        ("frames_sent", "0.5, 1.0, 2.0", True),
        ("frames_sent", "0.5, 1.0", True),
        ("messages", "0.5, 1.0, 2.0", True),
        ("messages", "0.5, 1.0", False),
    ],
)
def test_numbers_that_depend_on_the_step_are_not_compared_between_steps(
    metric: str, steps_s: str, is_refused: bool
) -> None:
    """Frames go out once a step; reports every second, unless a step is longer."""
    contrast = f'[[contrast]]\nid = "a"\nfactor = "step"\nreference = "step_s=0.5"\nmetrics = ["{metric}"]\n'
    sweep = STEPS.replace("0.5, 1.0, 2.0", steps_s)
    if not is_refused:
        assert made(BY_STEP + contrast, sweep)
        return
    with pytest.raises(SettingsError) as caught:
        made(BY_STEP + contrast, sweep)
    assert {problem.path for problem in caught.value.problems} == {"contrast[0].metrics"}
    assert "run.step_s" in str(caught.value)


def test_a_name_that_is_none_is_told_with_those_that_are() -> None:
    for own, said in (
        (
            CONTRAST.replace('"loss"', '"los"'),
            "contrast[0].factor must be one of 'loss', 'mode' (got 'los'; did you mean 'loss'?)",
        ),
        (CONTRAST.replace('"loss"', '"x"'), "contrast[0].factor must be one of 'loss', 'mode' (got 'x')"),
        (
            '[[finding]]\nheading = "t"\nresults = [{ claim = "x" }]\n',
            "finding[0].results[0].claim must be one of none that is declared (got 'x')",
        ),
    ):
        with pytest.raises(SettingsError) as caught:
            made(OWN + own)
        assert said in str(caught.value).splitlines()


def test_a_long_choice_is_listed_at_most_once() -> None:
    """A name that stands in many figures is one mistake; where one is suggested, no list is needed."""
    labels = [f"hybrid {number}" for number in range(40)]
    sweep = SWEEP.replace('label = ["decentralised", "hybrid 3"]', f"label = {labels}")
    sweep = sweep.replace('control.mode = ["decentralised", "hybrid"]', f"control.mode = {['hybrid'] * 40}")
    figure = '[[figure]]\nname = "f{}"\nkind = "boxes"\nmetric = "messages"\nx = "mode"\nvariants = {}\n'
    own = "".join(figure.format(i, ["loss=0.0, hybrid 39x", "quite another", "a third"]) for i in range(5))
    with pytest.raises(SettingsError) as caught:
        made(OWN + own, sweep)
    lines = str(caught.value).splitlines()
    assert len(lines) == 3
    assert lines[0] == (
        "figure[0].variants and 4 other places must be one of the 120 names (got 'loss=0.0, hybrid 39x'; did you mean "
        "'loss=0.0, hybrid 39'?)"
    )
    assert lines[1].startswith("figure[0].variants and 4 other places must be one of 'loss=0.0, hybrid 0', ")
    assert lines[2] == "figure[0].variants and 4 other places must be one of the 120 names listed above (got 'a third')"


def test_times_end_with_the_shortest_run() -> None:
    sweep = SWEEP.replace("radio.loss = [0.0, 0.5, 0.9]", "run.duration_s = [1000.0, 2000.0]")
    sweep = sweep.replace("run.duration_s = 1000.0\n", "")
    with pytest.raises(SettingsError, match=r"figure\[0\]\.at_s must be before the end of the runs, 1000 s"):
        made(OWN.replace("loss =", "duration_s =") + SWARM, sweep)
    late = '[[metric]]\nname = "w"\nkind = "window"\nof = "waiting_all"\nfrom_s = 900.0\n'
    with pytest.raises(SettingsError, match="must be less than 100 for 'w'"):
        made(OWN.replace('"waiting_all"', '"w"') + late)


def test_a_metric_over_windows_needs_a_series() -> None:
    sweep = SWEEP.replace("series_every_s = 100.0", "series_every_s = 0.0")
    assert made(OWN, sweep)
    with pytest.raises(SettingsError, match=r"sweep\.series_every_s must be above 0 for w"):
        made(OWN.replace('"waiting_all"', '"w"') + '[[metric]]\nname = "w"\nkind = "window"\nof = "trees"\n', sweep)


@pytest.mark.parametrize(
    ("sweep", "path"),
    [
        (SWEEP.replace("series_every_s = 100.0", "series_every_s = 100.5"), "sweep.series_every_s"),
        (SWEEP.replace("metrics.horizon_s = 100.0", "metrics.horizon_s = 1000.0"), "metrics.horizon_s"),
        (SWEEP.replace("series_every_s = 100.0", "series_every_s = 0.0"), "sweep.series_every_s"),
    ],
)
def test_a_sweep_that_cannot_answer_is_told_too(sweep: str, path: str) -> None:
    """Windows that are no whole steps, events that nobody follows long enough, a figure over time without a series."""
    with pytest.raises(SettingsError) as caught:
        made(OWN + DRAWN, sweep)
    assert path in [problem.path for problem in caught.value.problems]


def test_only_times_of_events_need_a_horizon_within_the_run() -> None:
    """Messages need none; waiting and completion do, over the part of the run that they are taken of."""
    longer = SWEEP.replace("metrics.horizon_s = 100.0", "metrics.horizon_s = 700.0")
    late = OWN.replace("window_s", "from_s = 300.0\nwindow_s")
    assert made(OWN, longer)
    assert made(late.replace('"waiting_all", "messages"', '"messages", "trees"'), longer)
    assert made(OWN.replace('"waiting_all", "messages"', '"messages"'), longer.replace("700.0", "1000.0"))
    for metric in ("waiting_all", "completion_s"):
        with pytest.raises(SettingsError) as caught:
            made(late.replace('"waiting_all", "messages"', f'"{metric}"'), longer)
        assert [problem.path for problem in caught.value.problems] == ["metrics.horizon_s"]


@pytest.mark.parametrize("horizons", ["[100.0, 1000.0]", "[1000.0, 100.0]"])
def test_the_longest_horizon_of_all_variants_counts(horizons: str) -> None:
    sweep = SWEEP.replace("metrics.horizon_s = 100.0", "").replace(
        "[sweep.axes]\nradio.loss = [0.0, 0.5, 0.9]", f"[sweep.axes]\nmetrics.horizon_s = {horizons}"
    )
    with pytest.raises(SettingsError) as caught:
        made(OWN.replace("loss =", "horizon_s ="), sweep)
    assert "metrics.horizon_s" in [problem.path for problem in caught.value.problems]


@in_one_test("window_s", [0.1, 0.3, 0.7, 1.1])
def test_windows_are_counted_in_whole_numbers(window_s: float) -> None:
    """Multiples that floating-point numbers do not have exactly are multiples all the same."""
    sweep = SWEEP.replace("series_every_s = 100.0", f"series_every_s = {window_s!r}")
    sweep = sweep.replace("run.duration_s = 1000.0", "run.duration_s = 400.0\nrun.step_s = 0.1")
    for factor in (3, 7, 29):
        own = OWN.replace("window_s = 100.0", f"from_s = {factor * window_s!r}\nwindow_s = {factor * window_s!r}")
        study = made(own.replace('"waiting_all"', '"trees"'), sweep)
        assert study.timing.windows(factor * window_s) == factor
        times_s = pd.Series([index * window_s for index in range(200)])
        assert study.timing.index(times_s).tolist() == list(range(200))


def test_a_misspelt_table_is_told_with_the_right_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "own.toml").write_text(SWEEP + OWN + "[[contrasts]]\n")
    assert main(["study", str(tmp_path / "own.toml"), "--plan"]) == 2
    assert "'contrast'" in capsys.readouterr().err


def test_a_study_file_is_a_sweep_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "own.toml").write_text(SWEEP + OWN)
    assert main(["sweep", str(tmp_path / "own.toml"), "--dry-run"]) == 0
    assert "6 variants x 10 replicates" in capsys.readouterr().out


def test_a_row_stands_for_each_combination_of_its_words() -> None:
    """In values, keys and lists; rows without `each` stay as they are, and words that are none are named."""
    row = {"id": "{cell}-{n}", "along": ["{cell}, x"], "paths": {"{n}": 1}}
    row |= {"each": {"cell": ["a", "b"], "n": ["1", "2"]}}
    rows, problems = expanded({"claim": [row, {"id": "{cell}"}], "study": {"title": "{n}"}})
    assert not problems
    assert [one["id"] for one in rows["claim"]] == ["a-1", "a-2", "b-1", "b-2", "{cell}"]
    assert rows["claim"][1] == {"id": "a-2", "along": ["a, x"], "paths": {"2": 1}}
    assert rows["study"] == {"title": "{n}"}
    for each in ("a", {"cell": "a"}, {"cell": []}, {"cell": [1]}):
        _, [problem] = expanded({"claim": [{"each": each}]})
        assert problem.path == "claim[0].each"
