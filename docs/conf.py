"""Sphinx's configuration. The source folder is the repository, so that links between pages work here and on a forge.

Build the site from the repository root: `sphinx-build -c docs . build/site`.
"""

import re
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

from deltaswarm_wire import __version__

project = "deltaswarm"
copyright = "the deltaswarm authors, Apache-2.0"
release = __version__

extensions = [
    "myst_nb",
    "sphinxcontrib.mermaid",
]
root_doc = "docs/index"
include_patterns = [
    "docs/**.md",
    "docs/notebooks/*.ipynb",
    "agent/*.md",
    "agent/deltaswarm_agent/controllers/paper/*.md",
    "examples/learn/result/*.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
]
exclude_patterns = [".*", "**/.*", "**/__pycache__", "build", "runs", "sweeps", "studies"]

# MyST: headings are link targets and `> [!WARNING]` is a warning, as on a forge; a fence named mermaid is a diagram.
myst_enable_extensions = ["alert"]
myst_heading_anchors = 3
myst_fence_as_directive = ["mermaid"]

# Notebooks are run when the site is built; with `-D nb_execution_mode=off` it has the outputs of their files.
nb_execution_mode = "force"
nb_execution_show_tb = True
nb_execution_timeout = 300
nb_output_stderr = "remove-warn"

html_theme = "furo"
html_title = f"deltaswarm {release}"
html_additional_pages = {"index": "to_index.html"}
html_copy_source = False
html_show_copyright = False
templates_path = ["templates"]


README = Path(__file__).parents[1] / "README.md"


def for_the_site(app: Sphinx, name: str, source: list[str]) -> None:
    """Begin the first page with the README, and show code that a page only links on a forge (`<!-- code: FILE -->`).

    The README's links are relative to the root of the repository.
    """
    if name == root_doc:
        app.env.note_dependency(str(README))
        readme = re.sub(r"\]\((?!https?:|#)", "](../", README.read_text(encoding="utf-8"))
        source[0] = f"{readme}\n{source[0]}"
    source[0] = re.sub(r"<!-- code: (\S+) -->", r"```{literalinclude} \1\n:language: python\n```", source[0])


def setup(app: Sphinx) -> None:
    """Show annotated bytes as they are; Pygments' own lexer for hexdumps knows another format."""
    app.add_lexer("hexdump", TextLexer)
    app.connect("source-read", for_the_site)
