"""The page, the figures and the plan of a sensitivity study, and what is refused before its runs."""

import math
import re
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_cli.main import main
from deltaswarm_studies.design import design
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.fixed import content, differences
from deltaswarm_studies.freezing import freeze
from deltaswarm_studies.page import pages, write
from deltaswarm_studies.plan import plan, text
from deltaswarm_studies.protocol import protocol_of, seeded
from deltaswarm_studies.sensitivity import sensitivity_of
from deltaswarm_studies.sensitivity_page import matrix, turning
from deltaswarm_wire.checked import SettingsError
from tests.support.drawn_studies import CLAIMED, DRAWN, found, noise, rate, table
from tests.support.studying import made

PROVENANCE = pd.DataFrame({"what": ["commit"], "value": ["abc"]})


def test_a_point_without_valid_runs_is_counted_and_no_loss() -> None:
    study = made(CLAIMED, DRAWN)
    rows = table(study, lambda values, number: 2.0)
    lost = (rows["variant"] == "trees") & rows["replicate"].isin([3, 4, 50])
    evidence = Evidence.of_sweep(study, rows[~lost].reset_index(drop=True), pd.DataFrame())
    assert evidence.sensitivity
    [share] = evidence.sensitivity.shares.to_dict("records")
    assert (share["n"], share["missing"], share["holds"], share["share"]) == (57, 3, 57, 1.0)
    assert re.search(r"Trees report less \| +57 \| +3 \| +57", pages(study, evidence, PROVENANCE)[1])


def test_several_runs_of_a_point_count_as_one() -> None:
    """Their mean is judged, and a point that lacks one of them is lost; the table of runs has them all."""
    study = made(CLAIMED, DRAWN.replace("points = 60", "points = 60\nruns_per_point = 2"))
    assert len(study.sweep.jobs()) == 240
    rows = table(study, lambda values, number: 3.0 if number % 2 else 0.5)
    lost = (rows["variant"] == "trees") & (rows["replicate"] == 7)
    evidence = Evidence.of_sweep(study, rows[~lost].reset_index(drop=True), pd.DataFrame())
    assert evidence.sensitivity
    [share] = evidence.sensitivity.shares.to_dict("records")
    assert (share["n"], share["missing"], share["holds"]) == (59, 1, 59)
    assert evidence.sensitivity.points["effect: quiet"].dropna().tolist() == [pytest.approx(1.75)] * 59
    assert len(evidence.runs) == 239
    page = pages(study, evidence, PROVENANCE)[1]
    assert "means of these runs are judged" in page
    assert "239 of 240" not in page
    assert "1 of 240 runs are missing: trees (replicates 7)." in page


def test_a_look_at_some_points_says_so() -> None:
    """The first 12 of 60 points, at the top of the page; of 9 no correlation is tested."""
    few = DRAWN.replace("prove = 0", "prove = 0\nrepeats = 12")
    study, evidence = found(lambda values, number: 2.0 * noise(number), sweep=few)
    assert len(study.sweep.jobs()) == 24
    line = "Only the first 12 of 60 points are run, so this is a look and no result."
    assert line in pages(study, evidence, PROVENANCE)[1].partition("## ")[0]
    _, evidence = found(lambda values, number: 2.0 * noise(number), sweep=few.replace("= 12", "= 9"))
    assert evidence.sensitivity
    assert evidence.sensitivity.keys["rho"].isna().all()
    assert [picture.name for picture in pages(study, evidence, PROVENANCE)[2]] == []


def test_the_page_is_made_again_from_its_tables(tmp_path: Path) -> None:
    study, evidence = found(lambda values, number: math.exp(2 * rate(values) - 1) * noise(number))
    files = {file.name: file.read_bytes() for file in write(study, evidence, PROVENANCE, tmp_path)}
    again = write(study, Evidence.of_folder(study, tmp_path), PROVENANCE, tmp_path)
    assert {"points.csv", "shares.csv", "keys.csv", "sensitivity.svg", "sensitivity-1.svg"} <= set(files)
    for file in again:
        if file.suffix != ".parquet":
            assert file.read_bytes() == files[file.name], file.name


def test_tables_from_before_the_drawing_say_what_they_lack() -> None:
    study, evidence = found(lambda values, number: 2.0)
    old = Evidence(study, evidence.runs.drop(columns="radio.range_m"), evidence.courses, evidence.recovery)
    assert any("no columns radio.range_m" in line for line in old.incomplete)
    assert "## Verdicts" in pages(study, old, PROVENANCE)[1]


def test_the_page_says_what_a_share_is_a_share_of() -> None:
    """The space with its distribution, the number of points and of tests, which the count at the end includes."""
    study, evidence = found(lambda values, number: math.exp(2 * rate(values) - 1) * noise(number))
    page = pages(study, evidence, PROVENANCE)[1]
    assert "At 60 points of a Latin hypercube" in page
    assert "| Event rate [1/s] | 0.05 to 0.5: uniform in the logarithm |" in page
    assert "| Recruitment | on, off: equally often |" in page
    assert "over 8 correlations" in page
    assert "9 tests in 2 families" in page
    assert "Event rate [1/s] (0 % where low, 100 % where high)" in page


def test_a_page_on_which_nothing_turns_a_claim_says_so() -> None:
    study, evidence = found(lambda values, number: noise(number))
    page = pages(study, evidence, PROVENANCE)[1]
    assert "no significant key" in page
    assert "Rank correlations that are shown" not in page


def test_differences_that_are_all_positive_are_not_called_times() -> None:
    """One side is 0 at a point, so there is no ratio there, and of no point the ratio is shown."""
    study, evidence = found(lambda values, number: noise(number))
    runs = evidence.runs
    runs.loc[(runs["variant"] == "trees") & (runs["replicate"] == 0), "messages"] = 0.0
    runs.loc[runs["variant"] == "none", "messages"] = 9.0
    result = sensitivity_of(study, runs)
    assert result
    figure = turning(study, result, study.file.claim[0], list(result.features[:2]))
    assert (result.points["effect: quiet"] > 0).all()
    assert figure.axes[0].get_yscale() == "linear"
    assert " ".join(figure.axes[0].get_ylabel().split()) == "Messages to the operator: none less trees [1/s]"


def test_figures_name_titles_with_units_and_no_keys() -> None:
    study, evidence = found(
        lambda values, number: (1.5 if values["control.recruitment"] == "on" else 0.6) * noise(number)
    )
    assert evidence.sensitivity
    claim, strongest = study.file.claim[0], evidence.sensitivity.strongest("quiet")
    figure = turning(study, evidence.sensitivity, claim, strongest[:2])
    choice, other = figure.axes
    assert choice.get_xlabel() == "Recruitment"
    assert [label.get_text() for label in choice.get_xticklabels()] == ["on", "off"]
    assert other.get_xlabel() in ("Event rate [1/s]", "Radio range [m]", "A member works on")
    assert " ".join(choice.get_ylabel().split()) == "Messages to the operator: none over trees [times]"
    [legend] = figure.legends
    [share] = evidence.sensitivity.shares.to_dict("records")
    words = [entry.get_text() for entry in legend.get_texts()]
    assert words == [f"holds ({share['holds']})", f"does not hold ({60 - share['holds']})"]
    assert len({handle.get_marker() for handle in legend.legend_handles}) == 2  # type: ignore[union-attr]
    titles = [label.get_text() for label in matrix(study, evidence.sensitivity).axes[0].get_xticklabels()]
    assert titles == ["Event rate [1/s]", "Radio range [m]", "Recruitment: off", "A member works on: all"]


@pytest.mark.parametrize(
    ("own", "sweep", "words"),
    [
        (CLAIMED.partition("[[claim]]")[0], DRAWN, "claim must be at least one [[claim]]"),
        (
            CLAIMED.replace('less = "trees"', 'kind = "predicts"\nless = "waiting"').replace('"none"', '"waiting_all"'),
            DRAWN,
            "claim[0].kind must be order, value or alike in a sensitivity study",
        ),
        (
            CLAIMED.replace(
                'less = "trees"', 'kind = "published"\nof = "trees"\npublished = 4.0\nsd = 1.0\nn = 20'
            ).replace('more = "none"\n', ""),
            DRAWN,
            "claim[0].kind must be order, value or alike in a sensitivity study",
        ),
        (CLAIMED.replace('more = "none"', 'every = ["none"]'), DRAWN, "claim[0].every must be left out"),
        (CLAIMED.replace('"trees"', '"forest"'), DRAWN, "claim[0] (quiet) must be one of 'trees', 'none'"),
    ],
)
def test_a_study_that_could_answer_nothing_is_refused(own: str, sweep: str, words: str) -> None:
    with pytest.raises(SettingsError) as caught:
        made(own, sweep)
    assert any(words in str(problem) for problem in caught.value.problems), caught.value


def of_lengths(low_s: float, high_s: float) -> str:
    drawn = DRAWN.replace("run.duration_s = 60.0\n", "").replace('"radio.range_m"', '"run.duration_s"')
    drawn = drawn.replace("high = 15.0", f"high = {high_s}").replace("low = 7.0", f"low = {low_s}\ninteger = true")
    return drawn.replace("series_every_s = 0.0", "series_every_s = 20.0")


def test_windows_of_time_need_runs_of_one_length() -> None:
    own = CLAIMED.replace('metrics = ["messages"]', 'metrics = ["messages"]\nuntil_s = 40.0')
    with pytest.raises(SettingsError, match=r"range\[1\].name must not be drawn with messages, whose windows"):
        made(own, of_lengths(50.0, 70.0))
    assert made(CLAIMED, of_lengths(50.0, 70.0)).ranges


def test_the_horizon_must_fit_the_shortest_run_of_all_points() -> None:
    """The first point's run is longer than the horizon of 20 s; another one's is not."""
    own = CLAIMED.replace('metrics = ["messages"]', 'metrics = ["messages", "waiting_all"]')
    assert made(own, of_lengths(21.0, 70.0)).sweep.variants[0].scenario.run.duration_s > 20.0
    assert made(CLAIMED, of_lengths(15.0, 70.0)).sweep.variants[0].scenario.run.duration_s > 20.0
    with pytest.raises(SettingsError, match=r"metrics.horizon_s must be less than 1[5-9]"):
        made(own, of_lengths(15.0, 70.0))


def test_the_plan_says_what_so_many_points_could_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """60 points: shares to within 13 percentage points; one claim and four keys, each correlated twice."""
    monkeypatch.setattr("deltaswarm_studies.plan.MEASURED_S", 0.0)
    lines = text(plan(made(CLAIMED, DRAWN), tmp_path, 2))
    assert "2 variants x 60 points, 120 runs" in lines
    assert "to within 13 percentage points; of 8 rank correlations" in lines


@pytest.mark.usefixtures("checked_by_python")
def test_a_study_is_looked_at_first_and_then_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Four points, then eight, which take over the first; one of them repeats, and the page is made again."""
    file, out = tmp_path / "made-up.toml", tmp_path / "out"
    file.write_text(DRAWN + CLAIMED.replace("[[claim]]", '[[claim]]\nexpect = "undecided"', 1))
    assert main(["study", str(file), "--repeats", "4", "--out", str(out), "-j", "2"]) == 0
    assert "first 4 of 60 points" in (out / "page.md").read_text()
    assert main(["study", str(file), "--repeats", "8", "--out", str(out), "-j", "2"]) == 0
    assert "8 of 16 runs are done already" in capsys.readouterr().err
    assert main(["study", str(file), "--repeats", "8", "--out", str(out), "--check", "2"]) == 0
    assert "2 of 2 repeated rows are equal" in capsys.readouterr().out
    page = (out / "page.md").read_text()
    assert main(["study", str(file), "--repeats", "8", "--out", str(out), "--render"]) == 0
    assert (out / "page.md").read_text() == page


def test_the_points_of_a_frozen_study_are_those_of_its_protocol(tmp_path: Path) -> None:
    """Not those of its file, whatever its seed is: runs at these points could have been looked at."""
    study, other = made(CLAIMED, DRAWN), made(CLAIMED, DRAWN.replace("[sensitivity]", "[sensitivity]\nseed = 7"))
    assert not differences(content(study), content(other))
    freeze(study, tmp_path, None)
    ours, theirs = (seeded(one, tmp_path).sweep for one in (study, other))
    keys = [[job.variant.scenario.radio.range_m for job in sweep.jobs()] for sweep in (ours, theirs, study.sweep)]
    assert keys[0] == keys[1] != keys[2]
    assert (len(keys[0]), ours.seeds) == (len(keys[2]), theirs.seeds)
    assert protocol_of(study, tmp_path).problems == []


def test_the_space_is_part_of_the_protocol_and_of_the_design() -> None:
    """Another end of a range is an amendment; no value of the first point is fixed, and the head names the ranges."""
    study, wider = made(CLAIMED, DRAWN), made(CLAIMED, DRAWN.replace("high = 15.0", "high = 16.0"))
    [change] = differences(content(study), content(wider))
    assert str(change) == "sensitivity.range.radio.range_m.high was 15.0, is 16.0"
    mechanism = " ".join(dict(design(study))["Data-generating mechanism"])
    assert "A replicate is one of 60 points of a Latin hypercube" in mechanism
    assert "event rate [1/s], 0.05 to 0.5: uniform in the logarithm" in mechanism
    assert "events per s" not in mechanism


def test_a_choice_that_turns_a_claim_is_told_by_without_and_with() -> None:
    study, evidence = found(lambda values, number: 1.5 if values["control.recruitment"] == "on" else 0.6)
    assert "Recruitment: off (100 % without, 0 % with)" in pages(study, evidence, PROVENANCE)[1]
