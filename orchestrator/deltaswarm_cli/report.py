"""Do a run for a command: show its progress and print its results."""

import json
import sys

from deltaswarm.runs import conduct
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.exits import complain, notice
from deltaswarm_orchestrator.base.output import print_result, results
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_scenario.scenario import Scenario


def run_and_report(scenario: Scenario, options: RunOptions, *, quiet: bool, as_json: bool = False) -> int:
    """Do a checked run and print its results; return the exit code."""
    from rich.console import Console

    from deltaswarm_orchestrator.run.progress import result_table

    result = conduct(scenario, options, quiet=quiet or options.debug)
    reasons = result.summary["invalid_because"] if as_json or result.summary["steps"] else []
    for message in result.messages:
        if not any(message in reason for reason in reasons):  # which are printed last
            complain(message)
    if as_json:
        print_result(json.dumps({"folder": str(result.folder), "exit_reason": result.exit_reason, **result.summary}))
    elif not result.summary["steps"]:
        complain(f"{result.exit_reason}: no step is on file; see {result.folder}")
        return result.code
    else:
        Console(file=results()).print(result_table(result.summary))
        print_result(str(result.folder))
        if sys.stderr.isatty():
            recording = "" if scenario.record == "off" else f"; open {result.folder / 'recording.mcap'} in a viewer"
            notice(f"next: {command_line('info', result.folder)}{recording}")
    if overruns := result.summary["realtime_overruns"]:
        complain(f"{overruns} steps took longer than real time")
    for reason in reasons:
        complain(f"not valid: {reason}")
    return result.code
