"""Claims that nothing could support, or nothing could contradict, are refused before the runs."""

from deltaswarm_studies.possible import bounds
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import FAST, OWN, SAME, SLOW, SWEEP, made
from tests.support.tiers import in_one_test

CLAIM = '[[claim]]\nid = "c{}"\ntext = "c"\n{}\n'
SHARE = '[[metric]]\nname = "late"\ntitle = "Late"\ncolumn = "waiting_time_s.beyond_horizon"\n'
CONVERGED = '[[metric]]\nname = "converged"\ntitle = "c"\nkind = "time_to_converge"\nof = "agents_in_trees"\n'
WINDOW = '[[metric]]\nname = "later"\ntitle = "w"\nkind = "window"\nof = "waiting_all"\nfrom_s = 500.0\n'
VALUE = 'kind = "value"\nof = "loss=0.9, hybrid 3"\n'
TREES = 'metric = "agents_in_trees"\n'
SUPPORT, CONTRADICT = "could support", "could contradict"


def refused(own: str, sweep: str = SWEEP) -> list[str]:
    """The messages with which a study is refused; [] if it is not."""
    try:
        made(own, sweep)
    except SettingsError as error:
        return [str(problem) for problem in error.problems]
    return []


@in_one_test(
    ("text", "says"),
    [
        # Runs have 6 agents and last 1000 s, events are followed for 100 s, the arena is 40 m wide and high.
        (VALUE + 'metric = "waiting_all"\nwithin = [99.0, 101.0]', ""),
        (VALUE + 'metric = "waiting_all"\nwithin = [100.1, 120.0]', SUPPORT),
        (VALUE + 'metric = "waiting_all"\nabove = 100.0', SUPPORT),
        (VALUE + 'metric = "waiting_all"\nabove = 99.9', ""),
        (VALUE + 'metric = "waiting_all"\nwithin = [-1e9, 1e9]', CONTRADICT),
        (VALUE + 'metric = "waiting_all"\nwithin = [0.0, 100.0]', CONTRADICT),
        (VALUE + 'metric = "waiting_all"\nwithin = [0.0, 99.9]', ""),
        (VALUE + 'metric = "waiting_all"\nwithin = [-3.0, -1.0]', SUPPORT),
        (VALUE + 'metric = "waiting_all"\nabove = -0.1', CONTRADICT),
        (VALUE + 'metric = "later"\nwithin = [100.1, 120.0]', SUPPORT),
        (VALUE + 'metric = "waiting"\nwithin = [100.1, 120.0]', ""),  # up to the end of the run
        (VALUE + 'metric = "waiting"\nabove = 1000.0', SUPPORT),
        (VALUE + 'metric = "converged"\nabove = 1000.0', SUPPORT),
        (VALUE + 'metric = "late"\nwithin = [1.01, 2.0]', SUPPORT),
        (VALUE + 'metric = "late"\nwithin = [0.9, 2.0]', ""),
        (VALUE + 'metric = "messages"\nwithin = [6.5, 9.0]', SUPPORT),
        (VALUE + 'metric = "messages"\nwithin = [5.5, 9.0]', ""),
        (VALUE + 'metric = "frames_received"\nwithin = [6.5, 90.0]', ""),  # each frame is received by many
        (VALUE + 'metric = "agents_in_trees"\nwithin = [6.1, 9.0]', SUPPORT),
        ('kind = "value"\nof = "loss=0.9, decentralised"\nmetric = "trees"\nwithin = [0.5, 2.0]', SUPPORT),
        (VALUE + 'metric = "trees"\nwithin = [0.5, 2.0]', ""),
        (VALUE + 'metric = "tree_area"\nabove = 1600.0', SUPPORT),
        (VALUE + 'metric = "root_distance"\nabove = 56.6', SUPPORT),
        (VALUE + 'metric = "root_distance"\nabove = 56.5', ""),
        (VALUE + 'metric = "completed"\nwithin = [12.1, 12.4]', SUPPORT),
        (VALUE + 'metric = "completed"\nwithin = [12.1, 12.6]', ""),  # the median of 12 and 13
        (VALUE + 'metric = "open_events"\nwithin = [12.1, 12.4]', ""),  # a mean over time
        # The source's error: 1.96 standard errors of a median, 0.929 * 10 / sqrt(25), are 3.64 to either side.
        (VALUE + 'metric = "waiting_all"\nwithin = [20.0, 27.2]\niqr = 10.0\nn = 25', SUPPORT),
        (VALUE + 'metric = "waiting_all"\nwithin = [20.0, 27.4]\niqr = 10.0\nn = 25', ""),
        (VALUE + 'metric = "waiting_all"\nabove = 20.0\niqr = 50.0\nn = 5', ""),
        # Orders and equivalences.
        (f'{TREES}less = "{FAST}"\nmore = "{SLOW}"', ""),
        (f'{TREES}less = "{SLOW}"\nmore = "{FAST}"', SUPPORT),  # a decentralised swarm has no trees
        ('kind = "predicts"\nmetric = "messages"\nless = "messages"\nmore = "waiting"', "nothing could hold"),
        ('kind = "predicts"\nmetric = "messages"\nless = "waiting"\nmore = "messages"', CONTRADICT),
        ('kind = "predicts"\nmetric = "messages"\nless = "waiting"\nmore = "trees"', ""),
        (f'less = "{SAME}"\nmore = "{SLOW}"\nexpect = "agrees"', "undecided, depends on the metric, refuted"),
        (f'kind = "alike"\na = "{SAME}"\nb = "{SLOW}"\nmargin = 1.1\nexpect = "differs"', "expect must be one of"),
    ],
)  # fmt: skip
def test_a_claim_must_be_possible_and_contestable(text: str, says: str) -> None:
    told = refused(OWN + SHARE + CONVERGED + WINDOW + CLAIM.format("", text))
    assert (len(told), says in "".join(told)) == (int(bool(says)), True), told


def test_the_message_says_what_to_do() -> None:
    """The key, what it has, the error at the level of Holm's first test among its source's claims, and a way out."""
    one = CLAIM.format("{}", VALUE + 'metric = "waiting_all"\nwithin = [20.0, 29.0]\niqr = 10.0\nn = 25')
    assert refused(OWN + one.format(0)) == []
    first, *others = refused(OWN + "".join(one.format(i) for i in range(5)))  # at 0.05 / 5: 2.576 errors
    assert len(others) == 4
    assert first == (
        "claim[0].within must be wider than 9.57: the error of the published number alone, 4.79 to either side at the "
        "level of its source's claims (0.01), exceeds it, so no number of runs could support it; widen it, or use kind "
        "'published' without it (the claim 'c0') (got 20 to 29)"
    )


def test_variants_with_the_same_scenario_are_not_compared() -> None:
    """Their runs are the same to the last bit, so a difference could not be supported, nor an equality contradicted."""
    sweep = SWEEP.replace('["decentralised", "hybrid 3"]', '["one", "two"]').replace(
        '["decentralised", "hybrid"]', '["hybrid", "hybrid"]'
    )
    sides = ("loss=0.9, one", "loss=0.9, two", "loss=0.5, two")
    order = CLAIM.format("", 'metric = "waiting_all"\nless = "{}"\nmore = "{}"\nat_least = {}')
    assert SUPPORT in refused(OWN + order.format(*sides[:2], 1.0), sweep)[0]
    assert CONTRADICT in refused(OWN + order.format(*sides[:2], 0.9), sweep)[0]
    assert refused(OWN + order.format(*sides[1:], 1.0), sweep) == []
    alike = CLAIM.format(
        "", f'metric = "waiting_all"\nkind = "alike"\na = "{sides[0]}"\nb = "{sides[1]}"\nmargin = 1.1'
    )
    assert CONTRADICT in refused(OWN + alike, sweep)[0]


def test_bounds_are_those_of_all_points_of_a_sensitivity_sweep() -> None:
    """The largest number of agents that is drawn, not that of the base scenario."""
    drawn = '[sensitivity]\npoints = 16\n[[sensitivity.range]]\nname = "agents.count"\ntitle = "Agents"\nlow = 4.0\n'
    sweep = SWEEP.replace("[sweep.axes]\nradio.loss = [0.0, 0.5, 0.9]\n", "") + drawn + "high = 9.0\ninteger = true\n"
    own = OWN.replace('loss = "frames lost [share]", ', "")
    own += CLAIM.format("", 'metric = "messages"\nless = "hybrid 3"\nmore = "decentralised"')
    assert bounds(made(own, sweep.replace("repeats = 10\n", "")), "agents_in_trees", "hybrid 3") == (0.0, 9.0)
