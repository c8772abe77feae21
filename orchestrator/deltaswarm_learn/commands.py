"""The command `deltaswarm learn`."""

import argparse
import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_cli.arguments import add_json, add_quiet, show
from deltaswarm_orchestrator.base.exits import OK, CommandError, notice
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_wire.arguments import number, whole
from deltaswarm_wire.extras import missing
from deltaswarm_wire.files import write_whole

if TYPE_CHECKING:
    from deltaswarm_learn.training import Training

EXAMPLES = """\
examples:
  deltaswarm learn delta --seed 1 --generations 32 --out policy.json --workers 2
  deltaswarm learn delta --seed 1 --generations 40 --out policy.json       go on for 8 generations
  deltaswarm learn inputs --policy policy.json --validation-tasks 4 --out inputs.md
  deltaswarm run paper-25 --set control.delta_rule=learned --set control.policy="$(jq -c .weights policy.json)"
"""

NEEDS = "cmaes", "numba"

BARS = "▁▂▃▄▅▆▇█"


def add_learn(command: argparse.ArgumentParser) -> None:
    """Train the rule by which agents choose delta."""
    command.description = (
        "Train the rule by which agents choose delta (control.delta_rule = learned) on tasks of many kinds. The policy "
        "that is best on the validation tasks is written with where it comes from. The result is the same for any "
        "number of workers; an interrupted training goes on from its log, OUT.log. Or say which inputs of a policy "
        "decide, by runs of validation tasks: what it chooses if one is permuted, or low or high everywhere."
    )
    command.epilog, command.formatter_class = EXAMPLES, argparse.RawDescriptionHelpFormatter
    command.add_argument("what", choices=("delta", "inputs"), help="train the rule, or tell what its inputs do")
    command.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="the policy's file, or that of a table"
    )
    command.add_argument("--policy", type=Path, metavar="FILE", help="of inputs: the policy (default: the shipped one)")
    command.add_argument("--seed", type=whole(0, 10_000), default=1, metavar="S", help="default: 1")
    command.add_argument("--generations", type=whole(1), default=32, metavar="G", help="default: 32")
    command.add_argument("--population", type=whole(4), default=32, metavar="N", help="candidates (default: 32)")
    command.add_argument("--tasks", type=whole(1), default=16, metavar="N", help="of a generation (default: 16)")
    command.add_argument("--sigma", type=number(1e-6), default=0.3, metavar="X", help="first step size (default: 0.3)")
    command.add_argument(
        "--validate-every", type=whole(1), default=4, metavar="N", help="generations between validations (default: 4)"
    )
    command.add_argument("--validation-tasks", type=whole(1), default=40, metavar="N", help="default: 40")
    command.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="a scenario key, for all runs; repeatable"
    )
    command.add_argument("--workers", type=whole(1), default=1, metavar="N", help="processes (default: 1)")
    add_json(command)
    add_quiet(command)
    command.set_defaults(func=learn, makes_files=True)


def learn(arguments: argparse.Namespace) -> int:
    """Train a policy, and write the best one after each validation; or tell what its inputs do."""
    if needs := missing(*NEEDS, extra="learn"):
        raise CommandError(f"deltaswarm learn {needs}")
    from deltaswarm_learn.costs import check_rule

    check_out(arguments.out.parent, is_ours=False)
    if arguments.out.is_dir():
        raise CommandError(f"--out must be a file (got the folder {str(arguments.out)!r})")
    check_rule(arguments.set)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    if arguments.what == "inputs":
        return _inputs(arguments)
    if arguments.generations < arguments.validate_every:
        must = f"at least --validate-every, {arguments.validate_every}: a policy is written once it was validated"
        raise CommandError(f"--generations must be {must} (got {arguments.generations})")
    from deltaswarm_learn.training import Pool, Training, TrainingSettings

    names = ("seed", "population", "tasks", "sigma", "validate_every", "validation_tasks")
    given = {name: getattr(arguments, name) for name in names}
    settings = TrainingSettings(**given, overrides=tuple(arguments.set))
    options = [f"--{name.replace('_', '-')}={getattr(arguments, name)}" for name in names]
    options += [f"--set={text}" for text in arguments.set]
    command = shlex.join(["deltaswarm", "learn", "delta", *options])
    pool = Pool(arguments.workers, settings.overrides)
    try:
        training = Training(settings, arguments.out.with_name(f"{arguments.out.name}.log"), pool)
        while training.generation < arguments.generations:
            least, mean = training.advance()
            notice(f"generation {training.generation}: cost {mean:.3f}, best {least:.3f}{_shown(training.curve)}")
            if training.generation % settings.validate_every == 0:
                _write(training, command, arguments.out)
        _write(training, command, arguments.out)
    finally:
        pool.close()
    cost = training.best[0]
    text = f"{arguments.out}: cost {cost:.3f} of that of hybrid control with delta 3"
    show(arguments, {"file": str(arguments.out), "cost": cost, "generations": training.generation}, text)
    return OK


def _inputs(arguments: argparse.Namespace) -> int:
    from deltaswarm_learn import inputs
    from deltaswarm_learn.training import learned, policy_in

    try:
        weights = policy_in(arguments.policy)
    except (OSError, ValueError) as error:
        raise CommandError(f"--policy {arguments.policy} {error}") from None
    noted = inputs.noted(range(arguments.validation_tasks), arguments.set, learned(weights))
    if not len(noted):
        raise CommandError(f"the tasks must last more than {inputs.EVERY_S:g} s, after which decisions are noted")
    found = list(inputs.influences(weights, noted))
    text = f"{inputs.table_of(found)}\n"
    write_whole(arguments.out, text.encode("ascii"))
    show(arguments, {"decisions": len(noted), "inputs": [one._asdict() for one in found]}, text)
    return OK


def _write(training: "Training", command: str, out: Path) -> None:
    record = training.record(f"{command} --generations={training.generation}")
    write_whole(out, f"{json.dumps(record, indent=1)}\n".encode("ascii"))


def _shown(curve: list[tuple[int, float]]) -> str:
    """Show the newest validated costs as bars."""
    if not curve:
        return ""
    newest = [cost for _, cost in curve[-20:]]
    low, high = min(newest), max(newest)
    bars = "".join(BARS[round((cost - low) / ((high - low) or 1.0) * (len(BARS) - 1))] for cost in newest)
    return f"; validated {curve[-1][1]:.3f}, least {min(cost for _, cost in curve):.3f} {bars}"
