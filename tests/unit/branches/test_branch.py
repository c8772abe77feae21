"""Branches in one process: without a difference they are their parents, and with one they differ from its step on."""

import shutil
import tomllib
from pathlib import Path
from random import Random

import pytest

from deltaswarm_branches.parent import read_parent
from deltaswarm_branches.plan import DECIDED, KEPT, Difference
from deltaswarm_cli.main import main
from deltaswarm_operator.core.budget import Structure
from deltaswarm_orchestrator.results.run_tables import read_outcome, read_rows
from tests.support.branching import AIR, FAULTS, SCRIPT, branched, manifest_of, ran, repetition_of, summary_of
from tests.support.complaints import Printed

PARENTS = {
    "a script, with faults": (SCRIPT, FAULTS, *AIR, "run.duration_s=200"),
    "a simulated person, half steps": (
        "operator.person.policy=threshold",
        "run.step_s=0.5",
        "run.duration_s=150",
        *AIR,
    ),
    "the system, long steps": ("operator.autonomy.sets_delta=system", "run.step_s=2", "run.duration_s=400", SCRIPT),
    "a budget": ("operator.autonomy.sets_delta=budget", "control.mode=adaptive", "run.duration_s=200"),
    "nobody": ("control.mode=decentralised", "run.duration_s=150"),
}


@pytest.fixture(scope="module")
def scripted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("runs") / "scripted", SCRIPT, "run.duration_s=200")


@pytest.mark.parametrize("sets", PARENTS.values(), ids=PARENTS)
def test_without_a_difference_a_branch_is_its_parent(sets: tuple[str, ...], tmp_path: Path) -> None:
    """At 7 random steps, whether later orders are the rule's or are given again in the parent's steps."""
    parent = read_parent(ran(tmp_path / "run", *sets, "operator.threshold_hz=1"))
    steps = Random(20).sample(range(1, parent.steps), 7)
    for later in ("", KEPT):
        repetition, plans = repetition_of(parent, *steps, difference=Difference(later=later))
        assert [repetition.go_on(planned).digest for planned in plans] == [parent.digest] * 7
        assert plans[0].changes_console == (bool(later) and parent.has_rule)


def test_a_branch_has_the_tables_of_its_parent(scripted: Path, tmp_path: Path) -> None:
    """From the folder that was made, also those of its first steps; and it says whose branch it is."""
    branch = branched(scripted, tmp_path / "branch", "--at", "77")
    assert summary_of(branch)["digest"] == summary_of(scripted)["digest"]
    assert summary_of(branch)["valid"]
    mine, theirs = read_outcome(branch), read_outcome(scripted)
    assert (mine.step_records, mine.workloads, mine.events) == (theirs.step_records, theirs.workloads, theirs.events)
    for name in ("events.csv", "commands.csv", "inbox.csv", "commands.toml"):
        assert (branch / name).read_bytes() == (scripted / name).read_bytes()
    manifest = manifest_of(branch)
    assert manifest["branch"]["parent"]["digest"] == summary_of(scripted)["digest"]
    assert (manifest["branch"]["at_step"], manifest["branch"]["difference"]) == (77, {})
    assert manifest["resumed"] == []


def test_what_came_before_the_branching_point_stays(scripted: Path, tmp_path: Path) -> None:
    """All steps before a dropped order are the parent's, and later orders keep their numbers and steps."""
    branch = branched(scripted, tmp_path / "branch", "--drop-command", "1")
    mine, theirs = read_outcome(branch), read_outcome(scripted)
    assert mine.step_records[:90] == theirs.step_records[:90]
    assert mine.step_records != theirs.step_records
    assert [row["command"] for row in read_rows(branch / "commands.csv")] == ["0", "2"]
    assert [(event.arrived_s, event.x_m) for event in mine.events] == [(e.arrived_s, e.x_m) for e in theirs.events]


def test_a_dropped_order_that_did_nothing_changes_nothing(scripted: Path, tmp_path: Path) -> None:
    """It was for nobody: the digest of what left the base differs, and no step and no event does."""
    branch = branched(scripted, tmp_path / "branch", "--drop-command", "2")
    mine, theirs = read_outcome(branch), read_outcome(scripted)
    assert mine.events == theirs.events
    moved = ("agents_in_trees", "events_open", "reports_sent", "reports_arrived")
    for name in moved:
        assert [getattr(row, name) for row in mine.step_records] == [getattr(row, name) for row in theirs.step_records]


def test_a_dropped_order_of_a_rule_is_taken_for_given(tmp_path: Path) -> None:
    """The simulated person waits before its next one; the same orders, kept, are given without it."""
    person = ("operator.person={policy='threshold', delta_limit=1, command_every_s=30}", "operator.threshold_hz=1")
    parent = read_parent(ran(tmp_path / "run", *person, "run.duration_s=300"))
    assert [order.by for order in parent.orders] == ["simulated"] * len(parent.orders)
    assert len(parent.orders) >= 2
    first = parent.orders[0]
    for later in (DECIDED, KEPT):
        repetition, (planned,) = repetition_of(parent, first.step, difference=Difference(drop=(0,), later=later))
        given = repetition.go_on(planned).world["commands"]
        assert all(command["at_s"] > first.command.at_s for command in given)
        if later == KEPT:
            assert [command["at_s"] for command in given] == [order.step * 1.0 for order in parent.orders[1:]]


def test_a_rule_for_a_budget_goes_on_from_its_last_order(tmp_path: Path) -> None:
    """At its times, whatever of it has changed; and from the structure that was ordered, not from the first one."""
    run = ran(
        tmp_path / "run",
        "control.mode=adaptive",
        "operator.autonomy.sets_delta=budget",
        "operator.threshold_hz=0.5",
        "operator.budget.every_s=20",
        "run.duration_s=300",
    )
    assert [float(row["sent_s"]) for row in read_rows(run / "commands.csv")] == [20.0 * place for place in range(1, 15)]
    levels = levels_of(run)
    for name, key, share in (
        ("slower", "operator.budget.gain=0.1", 0.5),
        ("looser", "operator.threshold_hz=100", -0.5),
    ):
        branch = branched(run, tmp_path / name, "--at", "155", "--set", key)
        assert [float(row["sent_s"]) for row in read_rows(branch / "commands.csv")] == [
            float(row["sent_s"]) for row in read_rows(run / "commands.csv")
        ]
        found = levels_of(branch)
        assert found[:7] == levels[:7]
        assert found[7] - found[6] == pytest.approx(share * (levels[7] - levels[6]), abs=0.02)


def levels_of(run: Path) -> list[float]:
    """The levels that a rule for a budget has ordered, by its orders."""
    orders = tomllib.loads((run / "commands.toml").read_text())["command"]
    return [Structure(**order["arguments"]).level for order in orders]


def test_orders_that_wait_can_be_dropped_too(tmp_path: Path) -> None:
    """Of 40 orders at once 16 leave in a step; one of the last that waits already at the branching point is dropped."""
    burst = ",".join(f'{{at_s=60, name="set delta", arguments={{delta={1 + n % 4}}}}}' for n in range(40))
    parent = read_parent(ran(tmp_path / "run", f"command=[{burst}]", "run.duration_s=100"))
    assert [order.step for order in parent.orders] == [60] * 16 + [61] * 16 + [62] * 8
    repetition, (planned,) = repetition_of(parent, 62, difference=Difference(drop=(35,)))
    given = repetition.go_on(planned).world["commands"]
    assert [command["at_s"] for command in given] == [60.0] * 16 + [61.0] * 16 + [62.0] * 7
    repetition, (planned,) = repetition_of(parent, 62, difference=Difference(later="dropped"))
    assert len(repetition.go_on(planned).world["commands"]) == 32


def test_an_added_order_and_another_mode_act(scripted: Path, tmp_path: Path) -> None:
    """An order where nobody was at the console, and agents that start anew: both differ from their step on."""
    plain = ran(tmp_path / "plain", "run.duration_s=150")
    added = 'name="hold", arguments={for_s=60}'
    branch = branched(plain, tmp_path / "added", "--at", "60", "--add-command", added)
    mine, theirs = read_outcome(branch), read_outcome(plain)
    assert [(row["name"], row["sent_s"]) for row in read_rows(branch / "commands.csv")] == [("hold", "58.0")]
    assert mine.step_records[:60] == theirs.step_records[:60]
    assert mine.step_records != theirs.step_records
    other = branched(scripted, tmp_path / "mode", "--at", "60", "--mode", "decentralised")
    assert {row.agents_in_trees for row in read_outcome(other).step_records[70:]} == {0}
    assert read_outcome(other).step_records[:60] == read_outcome(scripted).step_records[:60]
    assert summary_of(other)["valid"]


def test_another_inbox_shows_what_was_held_back(tmp_path: Path) -> None:
    """From its step on by another policy, which gets what the first one held; the swarm notices nothing."""
    sets = ("operator.person.policy=none", "operator.inbox={policy='digest', every_s=100}", "run.duration_s=150")
    run = ran(tmp_path / "run", *sets)
    branch = branched(run, tmp_path / "branch", "--at", "98", "--set", "operator.inbox={policy='all'}")
    assert summary_of(branch)["digest"] == summary_of(run)["digest"]
    mine, theirs = (read_rows(folder / "inbox.csv") for folder in (branch, run))
    assert [row["time_s"] for row in mine] == [row["time_s"] for row in theirs]
    held = [n for n, row in enumerate(mine) if float(row["time_s"]) < 96]
    assert {float(mine[n]["shown_s"]) for n in held} == {96.0}
    assert len(held) > 1


def test_other_randomness_is_common_to_both_sides(tmp_path: Path) -> None:
    """A replicate repeats, and differs from the parent only after its step; both sides have the same events."""
    parent = read_parent(ran(tmp_path / "run", SCRIPT, *AIR, "events.rate_hz=0.3", "run.duration_s=200"))
    repetition, (same,) = repetition_of(parent, 120)
    _, (without,) = repetition_of(parent, 120, difference=Difference(drop=(2,)))
    drawn = [repetition.go_on(planned, seed) for planned in (same, without) for seed in (7, 7, 8)]
    digests = [outcome.digest for outcome in drawn]
    assert digests[0] == digests[1]
    assert len({digests[0], digests[2], parent.digest}) == 3
    assert drawn[0].step_records[:120] == repetition.past.step_records[:120]
    arrivals = [[(event.arrived_s, event.x_m) for event in outcome.events] for outcome in drawn]
    assert arrivals[0] == arrivals[3] != arrivals[2]
    assert [a for a in arrivals[0] if a[0] < 119] == [a for a in arrivals[2] if a[0] < 119]


def test_a_run_that_cannot_be_repeated_is_refused(scripted: Path, tmp_path: Path, capsys: Printed) -> None:
    """One with another digest of messages or of events; a branch; a folder that is no run: one line each."""
    branch = branched(scripted, tmp_path / "branch", "--at", "77")
    for what in ("digest", "events_digest"):
        other = shutil.copytree(scripted, tmp_path / what)
        manifest = (other / "manifest.json").read_text().replace('"seal"', '"was"')
        (other / "manifest.json").write_text(manifest.replace(summary_of(scripted)[what], "0" * 32))
    capsys.readouterr()
    for run, says in (
        (branch, "must be no branch itself"),
        (tmp_path / "digest", "must repeat to its digest 0000"),
        (tmp_path / "events_digest", "must repeat to its events_digest 0000"),
        (tmp_path, "run"),
    ):
        assert main(["branch", str(run), "--at", "77", "--out", str(tmp_path / "new"), "--quiet"]) in (1, 2)
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1
        assert says in lines[0]
    assert not list(tmp_path.glob("new*"))


def test_by_force_a_branch_replaces_what_is_there(scripted: Path, tmp_path: Path, capsys: Printed) -> None:
    """A whole run and what is left of one, as `run` does; without it, both are refused before anything is done."""
    out, part = tmp_path / "branch", tmp_path / "branch.part"
    branched(scripted, out, "--drop-command", "1")
    shutil.copytree(out, part)
    for there in (out, part):
        kept = out if there == part else part
        kept.rename(tmp_path / "away")
        assert main(["branch", str(scripted), "--drop-command", "1", "--out", str(out)]) == 2
        assert f"{there} exists" in capsys.readouterr().err.splitlines()[0]
        (tmp_path / "away").rename(kept)
    whole = shutil.copytree(scripted, tmp_path / "whole")
    for force in ([], ["--force"]):
        assert main(["branch", str(whole), "--drop-command", "1", "--out", str(whole), *force]) == 2
        assert "--out must be another folder than RUN's" in capsys.readouterr().err
    assert (whole / "manifest.json").exists()
    shutil.rmtree(whole)
    (out / "mark").touch()
    branched(scripted, out, "--drop-command", "1", "--force")
    assert [path.name for path in tmp_path.iterdir()] == ["branch"]
    assert not (out / "mark").exists()
