"""Optional packages: each is in an extra that whoever lacks the package is told to install."""

import ast
import sys
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

from deltaswarm_wire.extras import NAMES, extras, missing_by, needed

ROOTS = [Path(__file__).parents[3] / part for part in ("agent", "world", "operator", "orchestrator")]


def test_every_import_is_of_a_requirement_that_can_be_named() -> None:
    """What no plain installation has is named by its extra where its import fails; nothing else is imported."""
    found = set()
    for file in chain.from_iterable(root.rglob("*.py") for root in ROOTS):
        for node in ast.walk(ast.parse(file.read_bytes())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            found |= {name.partition(".")[0] for name in names}
    foreign = found - sys.stdlib_module_names - {folder.name for root in ROOTS for folder in root.iterdir()}
    plain = {name.replace("-", "_") for name in needed()}
    installed = packages_distributions()
    optional = [module for module in foreign if not plain & {name.replace("-", "_") for name in installed[module]}]
    assert "scipy" in optional
    for module in optional:
        assert any(NAMES.get(module, module) in needed(extra) for extra in extras()), f"{module} is in no extra"
        assert "needs" in missing_by(ModuleNotFoundError(name=f"{module}.part"))
    assert missing_by(ModuleNotFoundError(name="of_a_user")) == ""
