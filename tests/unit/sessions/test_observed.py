"""What a run noted of itself and of its person, in the columns of the table of runs."""

import json
from pathlib import Path

from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.page_language import page_texts
from deltaswarm_scenario.person_tables import OperatorAction, ProbeRow, WallTimeRow
from deltaswarm_scenario.techniques import ProbeSettings
from deltaswarm_sessions.exclusion import ExclusionSettings
from deltaswarm_sessions.observed import hidden_s
from deltaswarm_sessions.tables import write_tables
from tests.support.sessions import SUMMARY, a_participant, edited, rows_of


def answer(probe: str, number: int, item: str, value: float | None, reaction_s: float | None = None) -> ProbeRow:
    """A row of probes.csv; an answer that took this long by the page's clock, or none."""
    given = "" if value is None else "2026-11-26T02:01:00.000Z"
    return ProbeRow(probe, number, item, value, 60.0, 9.0, answered_utc=given, reaction_s=reaction_s)


def test_what_a_run_noted_of_itself_is_in_its_columns(tmp_path: Path) -> None:
    """Start, duration, screen, scales, rules of exclusion; and of the participant: order, version, consent."""
    here = a_participant(tmp_path / "sessions", 1, "TAB")
    run = here / "1-A"
    manifest = {"started": "2026-11-26T02:00:00Z", "versions": {"deltaswarm": "0.1.0"}, "commit": "abc"}
    (run / "manifest.json").write_text(json.dumps(manifest))
    person = SUMMARY["person"] | {"page_away_s": 30.5, "answers_missing": 2}
    edited(run / "summary.json", person=person, task={"d_prime": -0.25})
    (run / "scenario.toml").write_text(to_toml(load_scenario("smoke", ["operator.probes.tlx=true"])))
    acts = [
        OperatorAction(0.0, "sheet", text="participant=P001; condition=1 A; consent_sha256=00aa"),
        *(OperatorAction(0.0, "page", name="size", text=text) for text in ("800x600", "900x600", "800x600")),
        OperatorAction(0.0, "page", name="zoom", text="2.00 px/m"),
    ]
    slow = [answer("isa", number, "isa", 3, seconds) for number, seconds in enumerate((1.0, 0.5, 3.0))]
    rows = [*slow, answer("isa", 9, "isa", None), answer("tlx", 0, "mental", 65), answer("tlx", 0, "mental weight", 3)]
    write_csv(run / "actions.csv", OperatorAction._fields, acts)
    write_csv(run / "probes.csv", ProbeRow._fields, rows)
    write_csv(run / "wall_times.csv", WallTimeRow._fields, [(0, 1.0, "", 100.0), (1, 2.0, "", 112.5)])
    rules = ExclusionSettings(max_page_away_s=30.5, max_answers_missing=1, min_d_prime=-0.25, min_answer_s=1.25)
    write_tables(here.parent, tmp_path / "data", rules, is_wide=True)
    _, row, other = rows_of(tmp_path / "data" / "runs.tsv")
    assert (row["started"], row["wall_duration_s"], row["screen"]) == (manifest["started"], "12.5", "800x600; 900x600")
    assert (row["tlx_mental"], row["tlx_physical"], row["median_answer_s"]) == ("65.0", "", "1.0")
    names = ("away_too_long", "too_many_missing", "d_prime_too_low", "answers_too_fast", "excluded")
    assert [row[name] for name in names] == ["0", "1", "0", "1", "1"], "a bound itself is allowed"
    assert [other[name] for name in names] == ["", "0", "", "", "0"], "without a value nothing is excluded"
    [person] = rows_of(tmp_path / "data" / "participants.tsv")
    assert [person[name] for name in ("started", "order", "versions", "consent")] == [
        manifest["started"],
        "A; B",
        "0.1.0 (abc)",
        "00aa",
    ]
    [wide] = rows_of(tmp_path / "data" / "wide.tsv")
    assert {name.partition(".")[2] for name in wide} == {"", "A", "B"}, "no training"
    assert (wide["participant"], wide["tlx_raw.A"], wide["answers_missing.B"]) == ("1", "40.0", "1")
    asked = rows_of(tmp_path / "data" / "questions.tsv")
    assert [(one["probe"], one["item"]) for one in asked] == [
        ("isa", "isa"),
        *(("tlx", scale) for scale in ("mental", "physical", "temporal", "performance", "effort", "frustration")),
    ]
    assert (asked[4]["low_text"], asked[4]["high_text"], asked[4]["high"]) == ("perfect", "failure", "100")


def test_the_page_and_the_table_name_the_same_anchors() -> None:
    """ISA and NASA-TLX are written in the page, not in a scenario."""
    texts = set(page_texts())
    asking = ProbeSettings(tlx=True).techniques
    for question in (question for technique in asking for question in technique.questions):
        assert {question.low_text, question.high_text, *question.choices} <= texts


def test_the_time_for_which_every_page_was_hidden_counts() -> None:
    """Only during the run, and not while another page of the participant is in view or none is open."""
    acts = [
        (90.0, "1", "hidden"),
        (110.0, "1", "visible"),
        (120.0, "1", "hidden"),
        (125.0, "2", "loaded"),
        (130.0, "2", "selected"),
        (140.0, "2", "hidden"),
        (143.0, "2", "size"),
        (150.0, "2", "closed"),
        (160.0, "1", "closed"),
    ]
    rows = [{"kind": "page", "monotonic_s": str(at), "page": page, "name": name} for at, page, name in acts]
    assert hidden_s(rows, [100.0, 200.0]) == 10.0 + 5.0 + 20.0
    assert hidden_s(rows, []) is None
