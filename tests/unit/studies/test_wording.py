"""Sentences that say more than was shown are refused: no difference without a margin, agreement by calibration."""

import re
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_studies.claims import claims_of
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.verdicts import claims_tables, counts, supported
from deltaswarm_studies.wording import says_no_difference
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import FAST, LIMIT, OWN, SAME, SLOW, made, worse_at_90
from tests.support.tiers import in_one_test
from tests.support.verdicts import runs_with

DOCS = Path(__file__).parents[3]
ALIKE = '[[claim]]\nid = "alike"\ntext = "a"\nkind = "alike"\nmetric = "waiting_all"\n'
ALIKE += f'a = "{FAST}"\nb = "{SAME}"\nmargin = 1.2\n'
ORDER = f'[[claim]]\nid = "order"\ntext = "o"\nmetric = "waiting_all"\nless = "{FAST}"\nmore = "{SLOW}"\n'
FAIR = '[[claim]]\nid = "fair"\ntext = "f"\nmetric = "waiting_all"\nkind = "published"\n'
FAIR += f'of = "{SAME}"\npublished = 25.0\nsd = 1.0\nn = 90\n'
FINDING = '[[finding]]\ntext = "{}"\nbecause = [{}]\n'
BY_ALIKE, BY_ORDER = '{ claim = "alike", is = "holds" }', '{ claim = "order", is = "holds" }'
BY_CONTRAST = '{{ contrast = "limit", metric = "waiting_all", level = "loss=0.5", is = "{}" }}'


def problems(own: str, first: str = OWN) -> dict[str, str]:
    try:
        made(first + own)
    except SettingsError as error:
        return {problem.path: str(problem) for problem in error.problems}
    return {}


@in_one_test(
    "text",
    [
        "Loss makes no difference.",
        "Loss does not matter.",
        "Events wait no longer.",
        "Hybrid 3 waits as long as decentralised control.",
        "Both wait the same time.",
        "Waiting is unchanged.",
        "Loss changes nothing.",
        "The operator hardly notices.",
        "Messages remain constant.",
    ],
)
def test_a_sentence_that_says_no_difference_needs_an_equivalence(text: str) -> None:
    """It is refused if it rests on an order, and taken with a claim of equivalence or a contrast within its margin."""
    assert "finding[0].text" in problems(ORDER + FINDING.format(text, BY_ORDER))
    assert problems(ALIKE + FINDING.format(text, BY_ALIKE)) == {}
    assert problems(LIMIT + FINDING.format(text, BY_CONTRAST.format("alike"))) == {}
    assert "finding[0].text" in problems(LIMIT + FINDING.format(text, BY_CONTRAST.format("unclear")))
    either = BY_CONTRAST.format("alike").replace('is = "alike"', 'is = ["alike", "higher"]')
    assert "finding[0].text" in problems(LIMIT + FINDING.format(text, either))


@in_one_test(
    "text",
    [
        "Events wait 1.6 times as long.",
        "Where it is no longer worth it, agents leave; events wait longer.",
        "At equal thresholds hybrid control completes events sooner.",
        "It waits no more than 3 s longer.",
        "Whether it makes a difference is open.",
        "Whether the two differ is undecided: no difference was shown, so it is open.",
    ],
)
def test_a_ratio_and_an_open_question_are_no_equality(text: str) -> None:
    assert problems(ORDER + FINDING.format(text, BY_ORDER)) == {}


def test_what_rests_on_an_undecided_result_must_say_that_it_is_open() -> None:
    """Whatever its other words: so a new way to say "no difference" does not slip through."""
    for because in (BY_CONTRAST.format("unclear"), '{ claim = "order", is = "undecided" }'):
        [told] = problems(LIMIT + ORDER + FINDING.format("Loss is a minor matter.", because)).values()
        assert "must say that something is open" in told
        assert problems(LIMIT + ORDER + FINDING.format("What loss does is open.", because)) == {}


@in_one_test(
    ("old", "new", "where"),
    [
        ("[study]", '[study]\ntitle = "No difference between modes"', "study.title"),
        ("", '[[figure]]\nname = "f"\nkind = "boxes"\nx = "mode"\ncaption = "Both wait as long."', "figure[0].caption"),
        ("", LIMIT + 'text = "Loss changes nothing"', "contrast[0].text"),
        ("[study]", '[study]\ntitle = "Does loss make no difference?"', ""),
        ("", '[[figure]]\nname = "f"\nkind = "boxes"\nx = "mode"\ncaption = "The same for waiting."', ""),
    ],
)
def test_a_text_that_rests_on_no_result_does_not_say_no_difference(old: str, new: str, where: str) -> None:
    """Titles and captions ask, or say what is shown."""
    own = OWN.replace(old, new) if old else f"{OWN}\n{new}\n"
    assert list(problems(own, "")) == ([where] if where else [])


def test_a_claim_of_an_order_does_not_say_no_difference() -> None:
    assert list(problems(ORDER.replace('"o"', '"Both wait as long"'))) == ["claim[0].text"]
    assert problems(ALIKE.replace('"a"', '"Both wait as long"', 1)) == {}


@in_one_test(
    ("own", "because"),
    [
        (LIMIT.replace("margin = 1.1\n", ""), BY_CONTRAST.format("alike")),
        (LIMIT.replace("margin = 1.1\n", ""), BY_CONTRAST.format("slightly lower")),
        (ORDER, '{ claim = "order", is = "agrees" }'),
        (FAIR, '{ claim = "fair", is = "holds" }'),
        (FAIR, '{ claim = "fair", is = "agrees" }'),
    ],
)
def test_a_finding_that_nothing_could_support_is_refused(own: str, because: str) -> None:
    """A contrast without a margin is never alike, nor does a published number agree without a tolerance."""
    assert list(problems(own + FINDING.format("Something follows.", because))) == ["finding[0].because[0].is"]
    within = FAIR.replace("sd =", "within = [20.0, 30.0]\nsd =")
    assert problems(within + FINDING.format("They agree.", '{ claim = "fair", is = "agrees" }')) == {}


def test_a_finding_is_shown_with_the_margin_of_its_equivalence() -> None:
    text = FINDING.format("Both wait as long.", f"{BY_ALIKE}, {BY_CONTRAST.format('alike')}")
    study = made(OWN + LIMIT + ALIKE + ORDER + text + FINDING.format("It waits less.", BY_ORDER))
    evidence = Evidence(study, runs_with(study, worse_at_90), pd.DataFrame(), pd.DataFrame())
    assert supported(study, evidence) == [
        "Both wait as long. (What does not differ is equivalent within 1.2 times or 1.1 times.)",
        "It waits less.",
    ]


CALIBRATED = FAIR + 'within = [20.0, 30.0]\ncalibrated = ["radio.range_m", "waiting_all"]\n'


def test_a_calibrated_number_is_counted_and_shown_apart() -> None:
    study = made(OWN + ORDER + CALIBRATED)
    claims = claims_of(study, runs_with(study, worse_at_90))
    assert counts(claims, is_calibrated=False) == {"holds": 1}
    assert counts(claims, is_calibrated=True) == {"agrees": 1}
    first, second = claims_tables(study, claims, None)
    assert [row[0] for row in first.rows] == ["o"]
    assert "Chosen by it" not in first.headings
    assert "their agreement is no evidence" in second.title
    assert [(row[0], row[-1]) for row in second.rows] == [("f", "radio.range_m, waiting_all")]


def test_no_finding_rests_on_the_agreement_of_a_calibrated_number() -> None:
    agrees = FINDING.format("The swarm waits 25 s.", '{ claim = "fair", is = "agrees" }')
    [told] = problems(CALIBRATED + agrees).values()
    assert "is no evidence: radio.range_m, waiting_all was chosen so that it agrees" in told
    assert problems(CALIBRATED.partition("calibrated")[0] + agrees) == {}
    assert problems(CALIBRATED + FINDING.format("It waits longer.", '{ claim = "fair", is = "differs" }')) == {}


def test_what_was_chosen_must_exist() -> None:
    with pytest.raises(
        SettingsError, match=r"claim\[0\]\.calibrated must be a key of the scenario, or a metric .*did you mean"
    ):
        made(OWN + CALIBRATED.replace("radio.range_m", "radio.rang_m"))


RESULTS = re.compile(r"\b(wait|complet|messages|waiting|hears|told)", re.IGNORECASE)


@pytest.mark.parametrize("page", ["README.md", "docs/beyond-the-paper.md", "docs/READINGS.md", "docs/studies/index.md"])
def test_what_the_pages_call_no_difference_has_its_margin(page: str) -> None:
    made = r"<!-- findings.*?<!-- end -->"  # a study's page has their margins
    text = re.sub(rf"```.*?```|!\[.*?\]\(.*?\)|{made}", "", (DOCS / page).read_text(), flags=re.DOTALL)
    said = [one for part in re.split(r"\n\n|\n\|", text) for one in says_no_difference(part)]
    assert [one for one in said if RESULTS.search(one) and "within" not in one and "?" not in one] == []
