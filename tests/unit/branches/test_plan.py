"""What may differ in a branch: a rule for every key, and a line for everything without a meaning."""

from pathlib import Path

import pytest

from deltaswarm_branches.keys import RULES, problem_of, rule_of
from deltaswarm_branches.parent import Parent, read_parent
from deltaswarm_branches.plan import DECIDED, DROPPED, KEPT, Difference, at_step, plan
from deltaswarm_orchestrator.cli import main
from deltaswarm_orchestrator.scenarios.load import keys_of
from deltaswarm_scenario.operator_links import CommandSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import SettingsError
from tests.support.branching import SCRIPT, ran
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test


@pytest.fixture(scope="module")
def scripted(tmp_path_factory: pytest.TempPathFactory) -> Parent:
    return read_parent(ran(tmp_path_factory.mktemp("runs") / "run", SCRIPT, "run.duration_s=160", "run.step_s=0.5"))


@pytest.fixture(scope="module")
def ruled(tmp_path_factory: pytest.TempPathFactory) -> Parent:
    sets = ("operator.autonomy={sets_delta='system', every_s=20, veto_s=0, delta_limit=1}", "operator.threshold_hz=0.5")
    return read_parent(ran(tmp_path_factory.mktemp("runs") / "run", *sets, "run.duration_s=160"))


def test_every_key_has_one_rule() -> None:
    """Each key of a scenario may differ or has a reason why not, and each rule is about some key."""
    keys = [key for key, *_ in keys_of(Scenario(), "")]
    used = {rule_of(key) for key in keys}
    assert None not in used
    assert used == set(RULES)
    assert rule_of("control.delta") is rule_of("control") is not None
    assert problem_of("operator.page.title")
    assert not problem_of("operator.person.policy")
    assert not problem_of("nonsense")


@in_one_test(
    ("difference", "at_s", "says"),
    [
        (Difference(), None, "--at must be given without --drop-command"),
        (Difference(), 0.0, "--at must be after the first step and before the end, from 0.5 to 159.5 s (got 0)"),
        (Difference(), 160.0, "--at must be after the first step"),
        (Difference(drop=(3,)), None, "--drop-command must be an order that left the base: 0 to 2 (got 3)"),
        (Difference(drop=(-1,)), 10.0, "--drop-command must be an order that left the base: 0 to 2 (got -1)"),
        (Difference(drop=(0,)), 50.0, "--drop-command must leave the base at or after --at (it left at 40 s)"),
        (Difference(drop=(1, 1)), 50.0, "--drop-command must name each order once"),
        (Difference(later=DECIDED), 50.0, "--later must be kept or dropped: no rule gives orders"),
        (Difference(sets=("agents.count=4",)), 50.0, "--set must be a key that can change within a run: the world"),
        (Difference(sets=("radio.burst.p_good_to_bad=0.1",)), 50.0, "--set must be a key that can change within a run"),
        (Difference(sets=("events.density.kind=uniform",)), 50.0, "--set must be a key that can change within a run"),
        (Difference(sets=("operator={task={is_on=true}}",)), 50.0, "operator.task"),
        (Difference(sets=("operator={page={title='x'}}",)), 50.0, "--set must be a key that can change within a run"),
        (Difference(sets=("control.nonsense=1",)), 50.0, "control.nonsense: unknown key"),
        (Difference(sets=("control.delta",)), 50.0, "--set must be key=value"),
        (Difference(sets=("operator.budget.gain=1",)), 50.0, "--set must be given with operator.autonomy.sets_delta"),
        (
            Difference(sets=("control.mode=potential",)),
            50.0,
            "the order 'hold' at 90 s must be a command that potential",
        ),
        (
            Difference(add=(CommandSettings(40.0, "hold", arguments={"for_s": 1}),)),
            50.0,
            "--add-command at_s must be from",
        ),
        (Difference(add=(CommandSettings(160.0, "resume"),)), 50.0, "--add-command at_s must be from 50 s"),
        (
            Difference(add=(CommandSettings(60.0, "dance"),)),
            50.0,
            "--add-command must be a command that hybrid accepts",
        ),
    ],
)
def test_what_has_no_meaning_is_refused(
    scripted: Parent, difference: Difference, at_s: float | None, says: str
) -> None:
    """Each with the key, what must hold and what was given."""
    with pytest.raises(SettingsError) as caught:
        plan(scripted, at_step(scripted, at_s, difference.drop), difference)
    assert any(str(problem).startswith(says) for problem in caught.value.problems), str(caught.value)


def test_without_a_time_a_branch_begins_with_the_first_dropped_order(scripted: Parent) -> None:
    """Which leaves in that step, whose turn is two steps earlier."""
    difference = Difference(drop=(2, 1))
    planned = plan(scripted, at_step(scripted, None, difference.drop), difference)
    assert (planned.at_step, planned.turn_step, planned.later) == (180, 178, KEPT)
    assert [scripted.is_dropped for scripted in planned.commands] == [True, True]
    assert at_step(scripted, 50.2, ()) == 100


def test_the_orders_of_a_rule_are_decided_anew_or_given_by_a_script(ruled: Parent) -> None:
    """Decided by default; kept and dropped orders need no rule, which is then off. A rule that is gone gives none."""
    first, second = ruled.orders[:2]
    planned = plan(ruled, first.step, Difference(drop=(0,)))
    assert (planned.later, planned.rule_drops, planned.commands) == (DECIDED, 1, ())
    assert planned.scenario.operator.commands
    for later in (KEPT, DROPPED):
        planned = plan(ruled, first.step, Difference(later=later))
        assert not planned.scenario.operator.commands
        assert [given.is_dropped for given in planned.commands] == [later == DROPPED] * len(ruled.orders)
    planned = plan(ruled, first.step, Difference(sets=("operator.autonomy.sets_delta=operator",)))
    assert (planned.later, planned.commands, planned.changes_console) == (DECIDED, (), True)
    assert not planned.scenario.operator.commands
    for difference in (Difference(drop=(1,)), Difference(drop=(0, 1)), Difference(drop=(1,), later=DECIDED)):
        with pytest.raises(SettingsError, match="must be the first order from --at on, number 0"):
            plan(ruled, first.step, difference)
    assert plan(ruled, second.step, Difference(drop=(1,))).rule_drops == 1
    with pytest.raises(SettingsError, match="must be given without --later kept"):
        plan(ruled, first.step, Difference(sets=("operator.autonomy.every_s=9",), later=KEPT))


def test_an_order_of_a_script_that_is_dropped_is_none_of_the_rule(tmp_path: Path) -> None:
    """The rule's own orders all leave, and the script's past orders are given once."""
    rule = ("operator.autonomy={sets_delta='system', every_s=20, veto_s=0, delta_limit=1}", "operator.threshold_hz=0.5")
    parent = read_parent(ran(tmp_path / "run", SCRIPT, *rule, "run.duration_s=160"))
    by_script = [order for order in parent.orders if order.by == "script"]
    assert len(by_script) == 3
    assert len(parent.orders) > 3
    planned = plan(parent, by_script[1].step, Difference(drop=(by_script[1].number,)))
    assert (planned.later, planned.rule_drops) == (DECIDED, 0)
    assert [given.is_dropped for given in planned.commands] == [True, False]
    assert [command.at_s for command in planned.scenario.command] == [40.0, 120.0]


def test_a_file_in_the_place_of_an_output_is_refused(scripted: Parent, capsys: Printed) -> None:
    """Before all runs."""
    file = scripted.folder / "value"
    file.touch()
    assert main(["value", str(scripted.folder)]) == 2
    assert f"{file}" in capsys.readouterr().err
    file.unlink()


def test_a_branch_replaces_another_if_it_is_forced_to(scripted: Parent, tmp_path: Path) -> None:
    """A complete one, too."""
    command = ["branch", str(scripted.folder), "--at", "50", "--quiet", "--out", str(tmp_path / "branch")]
    assert [main(command), main(command), main([*command, "--force"])] == [0, 2, 0]
    assert [path.name for path in tmp_path.iterdir()] == ["branch"]


@in_one_test(
    ("text", "says"),
    [
        ("x", "--add-command must be an order as in a scenario"),
        ("{name='hold'}}", "--add-command must be an order as in a scenario"),
        ("{name='hold'}\nat_s=100", "--add-command must be an order as in a scenario"),
        ("name='hold'\ncolour='red'", "--add-command.colour: unknown key"),
        ("name='hold', colour='red'", "--add-command.colour: unknown key"),
        ("name='hold', target='circle'", "--add-command.target must fit"),
    ],
)
def test_an_added_order_is_checked_as_it_is_read(scripted: Parent, capsys: Printed, text: str, says: str) -> None:
    """With the key that is wrong."""
    assert main(["branch", str(scripted.folder), "--at", "50", "--add-command", text]) == 2
    assert capsys.readouterr().err.startswith(f"deltaswarm: {says}")
