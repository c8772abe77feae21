"""A branch is the same whether the Python engine goes on from a state, or the dense engine does the whole run."""

import dataclasses
import json
from pathlib import Path

import pytest

from deltaswarm_branches.parent import read_parent
from deltaswarm_branches.plan import Difference
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.processes.elsewhere import DENSE, PYTHON
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_scenario.operator_links import CommandSettings
from tests.support.branching import ran, repetition_of
from tests.support.complaints import Printed
from tests.support.dense import _of

SCRIPT = (
    'command=[{at_s=40, name="set delta", arguments={delta=1}},'
    '{at_s=90, name="set structure", arguments={delta=2.5, working=0.4}},'
    '{at_s=92, name="set delta", arguments={delta=4}}, {at_s=150, name="set delta", arguments={delta=2}}]'
)
PERSON = "operator.person={policy='threshold', delta_limit=1, command_every_s=30}", "operator.threshold_hz=0.2"
BUDGET = "operator.autonomy.sets_delta=budget", "operator.budget.every_s=20", "operator.threshold_hz=0.5"
FAR = "downlink={loss=0.4, base_m=[0, 0], range_m=20}"
ADDED = CommandSettings(at_s=120.0, name="set delta", arguments={"delta": 3})


@pytest.mark.parametrize(
    ("sets", "at_s", "difference"),
    [
        ((SCRIPT, FAR), 90.0, Difference(drop=(1,))),
        ((SCRIPT, "radio.loss=0.2"), 92.0, Difference(later="dropped")),
        ((SCRIPT, "radio.loss=0.1", "radio.jitter_s=1.0", "uplink={loss=0.1, latency_s=2}"), 90.0, Difference((1, 2))),
        (("control.mode=adaptive",), 100.0, Difference(add=(ADDED,))),
        ((*PERSON, "operator.probes.isa_every_s=30.0", "uplink.loss=0.2"), 60.0, Difference()),
        (PERSON, 60.0, Difference(later="kept")),
        (BUDGET, 100.0, Difference(sets=("operator.budget.every_s=30",))),
    ],
)
def test_both_engines_have_the_same_branch(
    tmp_path: Path, sets: tuple[str, ...], at_s: float, difference: Difference
) -> None:
    """With the run's own random numbers, and with others from the branching point on."""
    parent = read_parent(ran(tmp_path / "run", "record=off", "run.duration_s=250", *sets))
    repetition, (plan,) = repetition_of(parent, round(at_s / parent.step_s), difference=difference)
    digests = [parent.digest]
    for seed in (None, 7, 8):
        (ours, by), (theirs, _) = (repetition.finish(plan, seed, engine) for engine in (DENSE, PYTHON))
        assert by.engine == DENSE
        digests.append(ours.digest)
        names = [field.name for field in dataclasses.fields(Outcome)]
        assert [name for name in names if _of(ours, name) != _of(theirs, name)] == []
    assert len(set(digests)) >= 3


def test_values_are_the_same_and_say_which_engine_did_the_runs(tmp_path: Path, capsys: Printed) -> None:
    run, tables = ran(tmp_path / "run", SCRIPT, "run.duration_s=250"), []
    capsys.readouterr()
    for engine in (DENSE, PYTHON):
        command = ["value", str(run), "--command", "1", "--replicates", "2", "--jobs", "1", "--engine", engine]
        assert main(command) == 0
        tables.append([(run / "value" / name).read_bytes() for name in ("commands_value.csv", "replicates.csv")])
        counted = json.loads((run / "value" / "seal.json").read_text())["engines"]
        assert counted == ({DENSE: 5, PYTHON: 1} if engine == DENSE else {PYTHON: 6})
    assert tables[0] == tables[1]


def test_other_branches_need_the_python_engine(tmp_path: Path) -> None:
    """Which does them, with the reason, unless the dense engine is insisted on."""
    fault = 'fault=[{kind="kill", at_s=100, agents=[1]}]'
    parent = read_parent(ran(tmp_path / "run", "record=off", "run.duration_s=150", fault))
    for sets, seed, because in (
        ("control.delta=2", None, "controllers start anew"),
        ("operator.threshold_hz=3", None, "threshold_hz changes"),
        ("operator.person.policy=none", 7, "faults are drawn anew"),
    ):
        repetition, (plan,) = repetition_of(parent, 80, difference=Difference(sets=(sets,)))
        _, by = repetition.finish(plan, seed)
        assert (by.engine, because in by.because) == (PYTHON, True)
        with pytest.raises(CommandError, match=because):
            repetition.finish(plan, seed, DENSE)


def test_an_engine_that_cannot_do_the_run_is_refused_before(tmp_path: Path, capsys: Printed) -> None:
    """And one that would have nothing to do."""
    run = ran(tmp_path / "run", SCRIPT, "run.duration_s=100", "downlink.latency_s=2")
    capsys.readouterr()
    for command, says in (
        (["value", str(run), "--engine", DENSE], "--engine dense cannot do this run: downlink.latency_s"),
        (["branch", str(run), "--at", "50", "--engine", DENSE], "--engine must be given with --replicates"),
    ):
        assert main(command) == 2
        assert capsys.readouterr().err.startswith(f"deltaswarm: {says}")
