"""Studies: from a question in a TOML file to runs and a page with figures and verdicts."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

FOLDERS = ("paper", "beyond", "limits", "operator")
"""The folders of the built-in studies."""


def files(*folders: str) -> "dict[str, Traversable]":
    """Return the files of the built-in studies in some folders, or in all, by name."""
    from deltaswarm_orchestrator.scenarios import files_in  # which a list of commands need not load

    named = [files_in(folder, package="deltaswarm_studies") for folder in folders or FOLDERS]
    return {name: file for each in named for name, file in each.items()}
