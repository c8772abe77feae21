"""For the API's pages: fields of settings with their meaning, and no "Alias for field number 0"."""

import dataclasses
from typing import Any

from sphinx.application import Sphinx


def add_fields(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Append the keys of a class of settings, each with what `key` says of it."""
    if what == "class" and dataclasses.is_dataclass(found):
        documented = [spec for spec in dataclasses.fields(found) if spec.metadata.get("doc")]
        lines += ["", *(f":ivar {spec.name}: {escaped(spec.metadata['doc'])}" for spec in documented)]


def escaped(text: str) -> str:
    """A text that is not meant as reStructuredText."""
    return text.replace("\\", "\\\\").replace("*", "\\*").replace("|", "\\|")


def skip(app: Sphinx, what: str, name: str, found: Any, is_skipped: bool, options: Any) -> bool | None:
    """Leave out the fields of named tuples that have no text of their own: the signature has them."""
    text = getattr(found, "__doc__", None) or ""
    return True if text.startswith("Alias for field number") else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", add_fields)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True}
