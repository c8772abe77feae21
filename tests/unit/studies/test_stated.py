"""Numbers in the words of a finding: each must be among what was found."""

import pandas as pd
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_studies.claims import findings_of, unsupported
from deltaswarm_studies.contrasts import contrasts_of
from deltaswarm_studies.tables import estimates_of, runs_of
from tests.support.studying import LIMIT, OWN, made, table, worse_at_90
from tests.support.tiers import in_one_test

ESTIMATES = [0.683, 1.25, 0.88]
MEDIANS = [65.2, 409.4]


@in_one_test(
    ("text", "wrong"),
    [
        ("Events wait 0.7 times as long.", []),
        ("Events wait 0.68 times as long.", []),
        ("Events wait 0.69 times as long.", ["0.69 times"]),
        ("Decentralised control waits 1.5 times as long.", []),  # 1 / 0.683
        ("Events wait 0.7 to 1.2 times as long.", []),
        ("Events wait 0.7 to 1.3 times as long.", []),  # 1.25 may be rounded either way
        ("Events wait 0.7 to 1.4 times as long.", ["0.7 to 1.4 times"]),
        ("They send 12 % fewer messages, 25 % more or 13 % less.", ["13 % less"]),
        ("They wait 65 instead of 409 s.", []),
        ("They wait 66 instead of 409 s.", ["66 instead of 409"]),
        ("They wait\n0.5 times as long.", ["0.5 times"]),
        ("With 25 agents and frames 5 to 10 s late nothing is said in numbers.", []),
    ],
)
def test_a_number_is_among_what_was_found(text: str, wrong: list[str]) -> None:
    assert list(unsupported(text, ESTIMATES, MEDIANS)) == wrong


@given(st.floats(0.05, 20.0), st.integers(0, 3))
def test_what_was_found_may_be_stated_with_any_precision(ratio: float, decimals: int) -> None:
    assert not list(unsupported(f"It takes {ratio:.{decimals}f} times as long.", [ratio], []))
    assert not list(unsupported(f"It takes {ratio:.{decimals}f} times as long.", [1 / ratio], []))


def test_nothing_found_supports_no_number() -> None:
    assert list(unsupported("1.0 times", [], [])) == ["1.0 times"]
    assert list(unsupported("3 times", [0.0], [])) == ["3 times"]


def test_a_finding_whose_number_is_not_found_is_left_out() -> None:
    because = (
        'because = [{ contrast = "limit", metric = "waiting_all", level = "loss=0.9", within = "hybrid 3", '
        'is = "higher" }]\n'
    )
    texts = "".join(
        f'[[finding]]\ntext = "Events wait {number} times as long."\n{because}' for number in ("2.0", "2.1")
    )
    study = made(OWN + LIMIT + texts)
    runs = runs_of(study, table(worse_at_90), pd.DataFrame())
    results = {"contrast": contrasts_of(study, runs), "estimates": estimates_of(study, runs)}
    assert findings_of(study, results)["broken"].tolist() == ["", "no result that it rests on is '2.1 times'"]
