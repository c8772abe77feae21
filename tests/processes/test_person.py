"""A simulated operator by real processes: the same acts, figures and digest as in one process, also after a kill."""

import csv
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.console_server import ConsoleServer, Outlet, SavedConsole
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.operator_settings import Briefing, OperatorSettings, PersonSettings
from deltaswarm_scenario.person_tables import TABLES
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.commands import Turn
from deltaswarm_wire.operator_messages import Clock, Workload
from tests.support.swarms import UNHURRIED, run, running, sets, wait_until
from tests.support.tiers import first_of

READER = ("operator.person.policy=none",)
COMMANDER = (
    *("operator.person.policy=threshold", "operator.threshold_hz=0.5", "operator.person.command_every_s=20"),
    *("control.delta=4", "run.duration_s=300"),
)


def inside(*overrides: str) -> dict[str, Any]:
    """The summary of a run of `smoke` in one process."""
    scenario = load_scenario("smoke", ["record=off", *overrides])
    return summarise(run_in_process(scenario), scenario)


SYSTEM = (
    *("operator.person.policy=none", "operator.autonomy.sets_delta=system", "operator.autonomy.signal=isa"),
    *("operator.probes.isa_every_s=20", "operator.autonomy.isa_high=1", "operator.autonomy.isa_low=1"),
    *("control.delta=4", "run.duration_s=300"),
)


ASKING = ("operator.probes.tlx=true", "operator.task.target_share=0.5", "run.duration_s=300")
"""Questions to which a simulated person has no answer."""


def run_tables(folder: Path) -> list[Path]:
    return [file for name in TABLES if (file := folder / f"{name}.csv").exists()]


def test_one_who_only_reads_does_not_touch_the_swarm() -> None:
    """The digest is that of the run without a person, which has no figures of one."""
    alone, read = inside(), inside(*READER)
    assert alone["digest"] == read["digest"]
    assert "person" not in alone
    person = read["person"]
    assert person["read"] > 0
    assert person["commands"] == 0
    assert person["items"] == person["read"] + person["missed"] + person["replaced"] + person["unread"]["last"]


def test_one_who_commands_changes_the_run_and_does_it_again() -> None:
    """From the seed alone; another seed makes other acts."""
    first, again, other = inside(*COMMANDER), inside(*COMMANDER), inside(*COMMANDER, "seed=2")
    assert first["digest"] == again["digest"]
    assert first["person"] == again["person"]
    assert first["person"]["commands"] > 0
    assert first["digest"] != inside("control.delta=4", "run.duration_s=300")["digest"]
    assert other["person"] != first["person"]


def test_a_controller_must_accept_what_the_policy_commands() -> None:
    """It is told before anything runs."""
    with pytest.raises(SettingsError, match=r"operator\.person\.policy"):
        load_scenario("smoke", ["control.mode=potential", "operator.person.policy=threshold"])


@pytest.mark.processes
@pytest.mark.parametrize("overrides", first_of([SYSTEM, READER, COMMANDER]), ids=["system", "none", "threshold"])
def test_processes_do_the_same(tmp_path: Path, overrides: tuple[str, ...]) -> None:
    """Digest, figures and tables of the person, byte for byte; they have a row per act."""
    options = ("--record", "off", *sets(*overrides, *ASKING))
    outside, alone = run(tmp_path / "run", *options), run(tmp_path / "alone", "--in-process", *options)
    tables = [{file.name: file.read_bytes() for file in run_tables(tmp_path / one)} for one in ("run", "alone")]
    assert tables[0] == tables[1]
    assert tables[0].keys() == {f"{name}.csv" for name in TABLES} - {"situation.csv", "wall_times.csv"}
    assert b"\ntlx,0,mental,,299.0,,,,,," in tables[0]["probes.csv"].replace(b"\r", b"")
    assert outside["digest"] == alone["digest"]
    assert outside["person"] == alone["person"]
    assert outside.get("autonomy") == alone.get("autonomy")
    with (tmp_path / "run" / "actions.csv").open(newline="") as table:
        acts = [(row["kind"], row["by"]) for row in csv.DictReader(table)]
    assert acts.count(("read", "simulated")) == outside["person"]["read"]
    assert acts.count(("command", "simulated")) == outside["person"]["commands"]
    by_system = acts.count(("command", "system"))
    assert by_system == outside.get("autonomy", {}).get("changes", 0)
    assert (by_system > 0) == (overrides is SYSTEM)


def test_turns_that_may_have_been_lost_with_a_process_are_said_again(tmp_path: Path) -> None:
    """The last two: the world began its newest step with the one before them."""
    briefing = Briefing(operator=OperatorSettings(person=PersonSettings(policy="threshold")))
    first: list[Turn] = []
    second: list[Turn] = []

    def console(sent: list[Turn], saved: SavedConsole | None = None) -> ConsoleServer:
        outlet = Outlet(sent.append, lambda _: None, briefing.is_awaited)
        return ConsoleServer("run", saved or Console(briefing), tmp_path, outlet)

    before = console(first)
    for step in range(5):
        workload = Workload(step, float(step), 0, 0, 0.0, 0.0, 0.0, 0, 0, 0)
        before.close_step(Clock(step, float(step), False), workload, ())
    after = console(second, before.state())
    after.start()
    assert [turn.step for turn in first] == [0, 1, 2, 3, 4]
    assert second == first[-2:]


@pytest.mark.processes
def test_an_operator_that_was_killed_goes_on_as_the_same_person(tmp_path: Path) -> None:
    """What it had read, what it was doing and what it would have drawn: nothing is lost, and no digest moves."""
    with running(tmp_path / "run", "--record", "off", *sets(*COMMANDER), *UNHURRIED) as swarm:
        operator = wait_until(lambda: swarm.pids.get("operator"), "the operator")
        for steps in (30, 50):
            swarm.wait_for_steps(steps)
            os.kill(operator, signal.SIGKILL)
            operator = wait_until(
                lambda before=operator: (pid := swarm.pids.get("operator")) and pid != before and pid, "its successor"
            )
        swarm.end_well()
        outside = swarm.summary()
    alone = inside(*COMMANDER)
    assert outside["operator_restarts"] == 2
    assert outside["digest"] == alone["digest"]
    assert outside["person"] == alone["person"]
    with (tmp_path / "run" / "actions.csv").open(newline="") as table:
        kinds = [row["kind"] for row in csv.DictReader(table)]
    assert kinds.count("read") == outside["person"]["read"]
    assert kinds.count("command") == outside["person"]["commands"]
