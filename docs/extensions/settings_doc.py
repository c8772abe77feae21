"""For the API's pages: fields of settings with their meaning and limits, and no "Alias for field number 0"."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from sphinx.application import Sphinx

from deltaswarm_wire.checked import shown_limit


def add_fields(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Append the keys of a class of settings, each with what `key` says of it."""
    if what == "class" and dataclasses.is_dataclass(found):
        documented = [spec for spec in dataclasses.fields(found) if spec.metadata.get("doc")]
        lines += ["", *(f":ivar {spec.name}: {escaped(meaning(spec.metadata))}" for spec in documented)]


def meaning(metadata: Mapping[str, Any]) -> str:
    """What a key means, and which values it takes."""
    names = {"above": "above", "low": "at least", "high": "at most", "length": "length"}
    limits = [f"{text} {shown_limit(metadata[name])}" for name, text in names.items() if metadata.get(name) is not None]
    if metadata.get("choices"):
        limits.append(f"one of {', '.join(metadata['choices'])}")
    return f"{metadata['doc']} ({', '.join(limits)})" if limits else str(metadata["doc"])


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
