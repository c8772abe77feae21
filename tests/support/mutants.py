"""Mutation tests: `python -m tests.support.mutants` changes one operator or number at a time, and runs its tests.

`[tool.mutants]` of pyproject.toml names the files and their tests; tests/mutants.md lists the accepted survivors.
Code in the folders of `[tool.sampled_mutants]` takes a minute to compile: `--sample 40` draws mutants at random.
"""

import argparse
import ast
import copy
import functools
import importlib.machinery
import os
import random
import re
import signal
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
ACCEPTED = ROOT / "tests" / "mutants.md"
MIN_KILLED_SHARE = 0.9
TIMEOUT_S, COMPILED_TIMEOUT_S = 120, 900
"""A mutant that takes longer is stopped; one of a sample has no verdict then, one that was not drawn is killed."""

SURVIVES, KILLED, TIMED_OUT = "survives", "killed", "too slow"

PAIRS = ["Lt LtE", "Gt GtE", "Eq NotEq", "Is IsNot", "In NotIn", "And Or", "Add Sub", "Mult Div"]
SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    getattr(ast, one): getattr(ast, other) for pair in PAIRS for one, other in (pair.split(), pair.split()[::-1])
}
NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "floor": "ceil", "ceil": "floor"}


class Mutant(NamedTuple):
    """One change of one file."""

    name: str
    source: str


def mutants_of(file: Path) -> Iterator[Mutant]:
    """Yield every mutant of a file; a name holds no line number, so that it outlives changes elsewhere."""
    tree, seen = ast.parse(file.read_text()), Counter[str]()
    for scope, node in expressions(tree):
        for change in changes(node):
            changed = copy.deepcopy(tree)
            before, after = ast.unparse(node), change(twin(tree, changed, node))
            label = f"{file.relative_to(ROOT)} {scope}: {before} -> {after}".replace("\n", " ")
            seen[label] += 1
            name = label if seen[label] == 1 else f"{label} ({seen[label]})"
            yield Mutant(name, ast.unparse(changed))


def expressions(tree: ast.AST, scope: str = "") -> Iterator[tuple[str, ast.AST]]:
    """Yield every node that runs, with the dotted name of its function; neither annotations nor decorators."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "decorator_list"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if isinstance(node, ast.AST):
                within = ".".join(filter(None, (scope, getattr(node, "name", "")))) if is_scope(node) else scope
                yield within, node
                yield from expressions(node, within)


def is_scope(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)


def twin(tree: ast.AST, other: ast.AST, node: ast.AST) -> ast.AST:
    """Return the node of a copied tree that stands where `node` stands in the original."""
    return next(b for a, b in zip(ast.walk(tree), ast.walk(other), strict=True) if a is node)


def changes(node: ast.AST) -> Iterator:  # type: ignore[type-arg]
    """Yield functions, each of which changes a node of this kind in place and returns its new text."""

    def setting(**fields: object):  # type: ignore[no-untyped-def]
        def change(one: ast.AST) -> str:
            for name, value in fields.items():
                setattr(one, name, value)
            return ast.unparse(one)

        return change

    match node:
        case ast.Compare(ops=[op]) | ast.BoolOp(op=op) | ast.BinOp(op=op) if type(op) in SWAPS:
            other = SWAPS[type(op)]()
            yield setting(ops=[other]) if isinstance(node, ast.Compare) else setting(op=other)
        case ast.Compare(ops=[_, _, *_] as ops):
            for at, op in enumerate(ops):
                if type(op) in SWAPS:
                    yield setting(ops=[*ops[:at], SWAPS[type(op)](), *ops[at + 1 :]])
        case ast.AugAssign(op=op) if type(op) in SWAPS:
            yield setting(op=SWAPS[type(op)]())
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield setting(operand=ast.UnaryOp(ast.Not(), operand))
        case ast.If(test=test) | ast.IfExp(test=test):
            if not isinstance(test, ast.Compare | ast.BoolOp | ast.UnaryOp):
                yield lambda one: setting(test=ast.UnaryOp(ast.Not(), one.test))(one).partition("\n")[0]
        case ast.Constant(value=bool(value)):
            yield setting(value=not value)
        case ast.Constant(value=int(value) | float(value)):
            yield setting(value=value + 1)
        case ast.Name(id=name) if name in NAMES:
            yield setting(id=NAMES[name])
        case ast.Attribute(attr=name) if name in NAMES:
            yield setting(attr=NAMES[name])


def fate_of(file: Path, tests: list[str], mutant: Mutant, timeout_s: int = TIMEOUT_S) -> str:
    """Run the tests with the mutant in place of the file, in a process of its own that has pytest loaded."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as cache:
        pid = os.fork()
        if pid == 0:
            signal.alarm(timeout_s)
            os.environ["XDG_CACHE_HOME"] = cache  # compiled code of a mutant is not for others
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(1, 2)
            original = importlib.machinery.SourceFileLoader.get_code

            def get_code(loader: importlib.machinery.SourceFileLoader, name: str):  # type: ignore[no-untyped-def]
                is_mutated = Path(loader.path) == file
                return compile(mutant.source, file, "exec") if is_mutated else original(loader, name)

            importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign, assignment]
            import pytest

            os._exit(
                int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow and not processes", *tests]))
            )
        status = os.waitpid(pid, 0)[1]
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM:
        return TIMED_OUT
    return KILLED if status else SURVIVES


def sampled(table: dict[str, list[str]], accepted: set[str], count: int, seed: int, jobs: int) -> int:
    """Try mutants drawn at random; print each with what became of it. Return 1 if one survives that is not accepted.

    One that runs out of time has no verdict: what is sampled is compiled anew for it, which takes most of the time.
    """
    files = [(file, tests) for folder, tests in table.items() for file in sorted((ROOT / folder).glob("*.py"))]
    made = [(file, tests, mutant) for file, tests in files for mutant in mutants_of(file)]
    drawn = random.Random(seed).sample(made, count)

    def tried(file: Path, tests: list[str], mutant: Mutant) -> str:
        fate = fate_of(file, tests, mutant, COMPILED_TIMEOUT_S)
        print(f"{fate:9}", mutant.name, flush=True)
        return "accepted" if fate == SURVIVES and mutant.name in accepted else fate

    with ThreadPoolExecutor(jobs) as pool:
        fates = Counter(pool.map(tried, *zip(*drawn, strict=True)))
    print(
        f"{count} of {len(made)} mutants, seed {seed}: {fates[KILLED]} killed, {fates[TIMED_OUT]} without a verdict, "
        f"{fates[SURVIVES]} survive that are not accepted"
    )
    return int(fates[SURVIVES] > 0)


def main() -> int:
    """Print each survivor; exit code 1 if one is not accepted, an accepted one is gone, or too few are killed."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.mutants", description=__doc__)
    parser.add_argument("only", nargs="*", metavar="FILE", help="only files whose path holds this (default: all)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="tests at once (default: cores)")
    parser.add_argument("--sample", type=int, metavar="N", help="try N mutants of the folders that are sampled")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="by which they are drawn (default: 1)")
    arguments = parser.parse_args()
    os.chdir(ROOT)
    for module in ("hypothesis", "numpy", "pandas", "pytest", "scipy.stats"):
        importlib.import_module(module)  # once for all mutants

    tool = tomllib.loads(Path("pyproject.toml").read_text())["tool"]
    table: dict[str, list[str]] = tool["mutants"]
    accepted = set(re.findall(r"^- `(.*?)`: \S", ACCEPTED.read_text(), re.MULTILINE))
    if arguments.sample:
        return sampled(tool["sampled_mutants"], accepted, arguments.sample, arguments.seed, arguments.jobs)
    wrong = False
    for path, tests in table.items():
        if arguments.only and not any(part in path for part in arguments.only):
            continue
        file = ROOT / path
        if fate_of(file, tests, Mutant("unchanged", file.read_text())) != SURVIVES:
            print(f"{path}: its tests fail without a mutant")
            wrong = True
            continue
        made = list(mutants_of(file))
        with ThreadPoolExecutor(arguments.jobs) as pool:
            fates = list(pool.map(functools.partial(fate_of, file, tests), made))
        survivors = {mutant.name for mutant, fate in zip(made, fates, strict=True) if fate == SURVIVES}
        gone = {name for name in accepted if name.startswith(f"{path} ")} - survivors
        killed = 1 - len(survivors) / max(len(made), 1)
        print(f"{path}: {len(made)} mutants, {killed:.1%} killed, {len(survivors - accepted)} survivors not accepted")
        print("".join(f"  survives: {name}\n" for name in sorted(survivors - accepted)), end="")
        print("".join(f"  accepted, but killed or gone: {name}\n" for name in sorted(gone)), end="", flush=True)
        wrong = wrong or bool(survivors - accepted or gone) or killed < MIN_KILLED_SHARE
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
