"""Sentences of findings: what they say of made-up results whose numbers are known, and what they never leave out."""

import re

import pandas as pd
import pytest

from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import FAST, LIMIT, OWN, SAME, SLOW, Value, made, worse_at_90
from tests.support.tiers import in_one_test
from tests.support.verdicts import NOISE, runs_with

WORDS = (
    '[study.words]\n"loss=0.0" = "without loss"\n"loss=0.5" = "with loss 0.5"\n"loss=0.9" = "with loss 0.9"\n'
    'decentralised = "alone"\n"hybrid 3" = "in trees"\nmode = "in both modes"\n'
)
FINDING = '[[finding]]\nheading = "Loss"\nresults = [{}]\n'


def told(own: str, result: str, waiting: Value = worse_at_90, **others: Value) -> list[str]:
    study = made(OWN + WORDS + own + FINDING.format(result))
    return evidence(study, waiting, **others).findings[0].sentences  # type: ignore[return-value]


def evidence(study: Study, waiting: Value, **others: Value) -> Evidence:
    return Evidence(study, runs_with(study, waiting, **others), pd.DataFrame(), pd.DataFrame())


def test_results_with_one_verdict_are_told_together_and_the_others_named() -> None:
    """Three of four are alike; the fourth is twice as long; each with its place, interval and n."""
    [sentence] = told(LIMIT, '{ contrast = "limit", metric = "waiting_all" }')
    first, *others = sentence.split("; ")
    assert first.startswith(
        "The mean time until an event is sensed is as long with loss 0.5 as without loss, in both modes"
    )
    assert "1.1 times" in first
    [twice] = [part for part in others if "2.00 times" in part]
    assert "with loss 0.9" in twice
    assert "in trees" in twice
    [alone] = [part for part in others if part is not twice]
    assert "with loss 0.9 alone" in alone
    assert len(re.findall(r"n = 10", sentence)) == 3


def test_a_finding_names_only_what_it_chooses() -> None:
    chosen = '{ contrast = "limit", metric = "waiting_all", level = "loss=0.9", within = "hybrid 3" }'
    assert told(LIMIT, chosen) == [
        "The mean time until an event is sensed is 2.00 times as long with loss 0.9 as without loss, in trees "
        "(interval 2.00 to 2.00, n = 10)."
    ]


def test_each_metric_has_a_sentence_of_its_own_in_its_own_number() -> None:
    chosen = '{ contrast = "limit", metric = ["waiting_all", "messages"], level = "loss=0.9", within = "hybrid 3" }'
    one, other = told(LIMIT, chosen, messages=worse_at_90)
    assert one.startswith("The mean time until an event is sensed is 2.00 times as long")
    assert other.startswith("Messages to the operator are 2.00 times as many")


@in_one_test(
    ("margin", "kind"),
    [("margin = 1.1\n", "too few runs: about"), ("", "no margin is set: about")],
)
def test_what_is_open_says_which_of_three_it_is(margin: str, kind: str) -> None:
    chosen = '{ contrast = "limit", metric = "waiting_all", level = "loss=0.9", within = "hybrid 3" }'
    own = LIMIT.replace("margin = 1.1\n", margin)

    def some(level: str, mode: str, replicate: int) -> float:
        return (20.0 + replicate) * (1 + (NOISE[replicate] - 0.15) * (level == "loss=0.9"))

    [sentence] = told(own, chosen, some)
    assert sentence.startswith("It is open whether the mean time until an event is sensed is longer or shorter")
    assert kind in sentence
    [never] = told(own.replace("margin = 1.1\n", ""), chosen, lambda _level, _mode, replicate: 20.0 + replicate)
    assert "no number of runs can close the question" in never


ORDER = f'[[claim]]\nid = "o"\ntext = "o"\nmetric = "waiting_all"\nsays = "twice"\nless = "{SLOW}"\nmore = "{SAME}"\n'


def test_what_a_source_says_stands_beside_what_contradicts_it() -> None:
    [sentence] = told(ORDER, '{ claim = "o" }')
    assert sentence.startswith("The mean time until an event is sensed is 0.50 times as long without loss")
    assert sentence.endswith("the opposite of the claim. The source says: “twice”.")
    holding = ORDER.replace("less", "m").replace("more", "less").replace("\nm =", "\nmore =")
    assert "The source says" not in " ".join(told(holding, '{ claim = "o" }'))


def test_agreement_by_calibration_is_called_no_evidence() -> None:
    own = f'[[claim]]\nid = "v"\ntext = "v"\nkind = "value"\nmetric = "waiting_all"\nof = "{FAST}"\n'
    own += "within = [10.0, 40.0]\n"
    assert "no evidence" in told(own + 'calibrated = ["radio.range_m"]\n', '{ claim = "v" }')[0]
    assert "no evidence" not in told(own, '{ claim = "v" }')[0]


def test_a_difference_is_told_with_its_unit_and_its_sign_in_words() -> None:
    """Values of 0 leave no ratio."""
    chosen = '{ contrast = "limit", metric = "waiting_all", level = "loss=0.9", within = "hybrid 3" }'
    [sentence] = told(LIMIT, chosen, lambda level, mode, r: float(r) if level == "loss=0.9" else 3.0 + r)
    assert "is 3.00 s shorter with loss 0.9 than without loss, in trees (interval 3.00 to 3.00, n = 10)" in sentence


def test_an_open_difference_keeps_its_sign_and_that_of_its_interval() -> None:
    """Most of the ten differences are below 0, so its interval reaches farther below 0 than above."""
    apart = (2.0, -6.0, -5.0, -5.0, -4.0, 3.0, -3.0, 1.0, -2.0, -1.0)
    chosen = '{ contrast = "limit", metric = "waiting_all", level = "loss=0.9", within = "hybrid 3" }'
    [sentence] = told(LIMIT, chosen, lambda level, mode, r: 9.0 * r + (apart[r] if level == "loss=0.9" else 0.0))
    [found] = re.findall(r"difference (\S+), interval (\S+) to (\S+), n = 10", sentence)
    estimate, low, high = map(float, found)
    assert low < estimate < 0 < high < -low


def test_a_difference_from_a_multiple_says_from_what() -> None:
    """Twice as much is less than three times as much, and not less; claims on both sides of 0 are told apart."""
    head = '[[claim]]\nid = "{}"\ntext = "t"\nmetric = "waiting_all"\n'
    sides = 'less = "loss=0.0, {0}"\nmore = "loss=0.9, {0}"\nat_least = {1}\n'
    own = head.format("a") + sides.format("hybrid 3", 3.0) + head.format("b") + sides.format("decentralised", 1.5)
    twice = lambda level, mode, r: (2.0 if level == "loss=0.9" else 1.0) * r  # noqa: E731
    one, other = sorted(told(own, '{ claim = ["a", "b"] }', twice))
    assert "4.50 s shorter with loss 0.9 than 3 times that without loss, in trees" in one + other
    assert "2.25 s longer with loss 0.9 than 1.5 times that without loss, alone" in one + other


def test_an_interaction_of_differences_is_no_ratio() -> None:
    own = LIMIT.replace('id = "limit"', 'id = "limit"\nacross = "mode"\nacross_pairs = [["hybrid 3", "decentralised"]]')
    chosen = '{ contrast = "limit", metric = "waiting_all", level = "loss=0.9" }'
    [sentence] = told(own, chosen, lambda level, mode, r: r + 5.0 * (level == "loss=0.9" and mode == "hybrid 3"))
    assert sentence.startswith(
        "The difference of the mean time until an event is sensed with loss 0.9 from that without loss is 5.00 s "
        "longer in trees than alone"
    )


FIT = """
[[fit]]
text = "fit"
factor = "mode"
targets = [
    { level = "hybrid 3", metric = "waiting_all", says = 60.0, iqr = 10.0 },
    { level = "decentralised", metric = "messages", says = 25.0, iqr = 5.0 },
]
"""


def test_the_closest_combination_is_told_with_the_next() -> None:
    [sentence] = told(FIT, '{ fit = "fit" }')
    assert sentence.startswith("Of 3 combinations the one with loss 0.9 comes closest")


def test_no_template_lacks_a_word() -> None:
    """Every kind of claim, with every verdict that these runs give it, and with no data."""
    head = '[[claim]]\nid = "{}"\ntext = "t"\nmetric = "waiting_all"\n'
    bodies = [f'less = "{less}"\nmore = "{more}"\nat_least = {least}\n' for less, more, least in
              ((FAST, SLOW, 1.5), (SLOW, FAST, 1.5), (FAST, SAME, 1.0), (FAST, SLOW, 1.99))]  # fmt: skip
    bodies += [
        f'kind = "alike"\na = "{FAST}"\nb = "{b}"\nmargin = {m}\n' for b, m in ((SAME, 1.1), (SLOW, 1.1), (SLOW, 2.0))
    ]
    bodies += [f'kind = "value"\nof = "{FAST}"\nwithin = [{a}, {b}]\n' for a, b in ((15, 40), (50, 60), (25.0, 26.0))]
    bodies += [f'kind = "value"\nof = "{FAST}"\nwithin = [15, 40]\nreference = "{SAME}"\n']
    bodies += [f'kind = "published"\nof = "{FAST}"\npublished = {p}\nsd = 1.0\nn = 20\n' for p in (25.0, 90.0)]
    bodies += [f'kind = "published"\nof = "{FAST}"\npublished = 25.5\nsd = 1.0\nn = 90\nwithin = [15.0, 40.0]\n']
    bodies += ['kind = "predicts"\nless = "messages"\nmore = "waiting"\n']
    bodies += [f'kind = "trend"\nalong = ["{FAST}", "{SAME}", "{SLOW}"]\n']
    own = "".join(head.format(place) + body for place, body in enumerate(bodies))
    names = ", ".join(f'"{place}"' for place in range(len(bodies)))
    study = made(OWN + WORDS + own + FINDING.format(f"{{ claim = [{names}] }}"))
    for runs in (
        runs_with(study, worse_at_90),
        runs_with(study, worse_at_90).query("variant != @FAST", local_dict={"FAST": FAST}),
    ):
        found = Evidence(study, runs, pd.DataFrame(), pd.DataFrame())
        text = " ".join(found.findings[0].sentences)
        assert not re.search(r"[{}]|\bnan\b|  | ,|\(\(", text)
        assert text[-1] in ".”"
        assert len(set(found.claims["verdict"])) >= (5 if FAST in set(runs["variant"]) else 1)


def test_a_word_for_a_level_that_does_not_exist_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"study\.words"):
        made(OWN + '[study.words]\n"loss=0.6" = "with loss"\n')
