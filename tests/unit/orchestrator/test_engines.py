"""What an engine, a command or a collection of sweeps from outside returns is checked where it is called."""

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.processes.elsewhere import engine_of
from deltaswarm_orchestrator.sweeps.load import built_in
from deltaswarm_wire.plugin_errors import PluginError
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test


class _Lab:
    """An engine that is not there, and returns nothing that a run could use."""

    def __init__(self, scheduler: str | None, listen: str = "") -> None:
        if scheduler is None:
            raise RuntimeError("no cable")

    def check(self, scenario: Any) -> None:
        raise CommandError("the laboratory is closed")

    def placed(self, agents: int, say: Any) -> Any:
        places = SimpleNamespace(workers=3, agents=lambda scenario, logs: None)
        return None if agents == 0 else nullcontext(places if agents == 1 else 3)

    def sweep_engine(self, workers: int) -> Any:
        return SimpleNamespace(run=lambda tasks: iter([3])) if workers else 3


def _agents(engine: Any) -> None:
    with engine.placed(1, print) as placement:
        placement.agents(None, None)


def _workers(engine: Any) -> None:
    with engine.placed(1, print) as placement:
        placement.workers.items()


@in_one_test(
    ("use", "said"),
    [
        (lambda engine: engine.placed(0, print), "_Lab.placed must return an object with __enter__"),
        (lambda engine: engine.sweep_engine(0), "_Lab.sweep_engine must return an object with run"),
        (lambda engine: [*engine.sweep_engine(2).run([])], "_Lab: run must yield Done"),
        (lambda engine: engine.placed(2, print).__enter__(), "_Lab.placed must yield a Placement"),
        (_agents, "agents must return an object with listen"),
        (_workers, "workers must return an object with items"),
        (lambda engine: engine_of(f"{__name__}:_Lab", None), "_Lab failed: RuntimeError: no cable"),
    ],
)
def test_an_engine_that_returns_nonsense_is_named(use: Any, said: str) -> None:
    """With its place; that it refuses a scenario is no failure."""
    engine: Any = engine_of(f"{__name__}:_Lab", "tcp/lab")
    with pytest.raises(PluginError) as caught:
        use(engine)
    assert said in str(caught.value)
    with pytest.raises(CommandError, match="the laboratory is closed"):
        engine.check(None)


ADDED = """
def returns(command):
    command.set_defaults(func=lambda arguments: None)

def raises(command):
    raise RuntimeError("no hands")

def forgets(command):
    pass

def files():
    return ["mine.toml"]
"""


@in_one_test(
    ("points", "argv", "said"),
    [
        ("[deltaswarm.commands]\nreturns = added_parts:returns", ["returns"], "must return an exit code"),
        ("[deltaswarm.commands]\nraises = added_parts:raises", ["raises"], "raises failed: RuntimeError: no hands"),
        ("[deltaswarm.commands]\nforgets = added_parts:forgets", ["forgets"], "must set the default func"),
        ("[deltaswarm.sweeps]\nours = added_parts:files", ["list"], "files must return a dict of files"),
    ],
)
def test_a_command_or_collection_is_named(
    points: str, argv: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """In one line with its place, and exit code 1."""
    (tmp_path / "added_parts.py").write_text(ADDED)
    (tmp_path / "added_parts-1.dist-info").mkdir(exist_ok=True)
    (tmp_path / "added_parts-1.dist-info" / "METADATA").write_text("Name: added_parts\nVersion: 1\n")
    (tmp_path / "added_parts-1.dist-info" / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(tmp_path)
    built_in.cache_clear()
    try:
        assert main(argv) == 1
    finally:
        built_in.cache_clear()
    line = capsys.readouterr().err.splitlines()[0]
    assert line.startswith("deltaswarm: added_parts:")
    assert said in line
    assert f"{tmp_path / 'added_parts.py'}:" in line
