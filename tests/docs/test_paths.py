"""Files and modules that the pages name exist."""

import re
from pathlib import Path

from tests.support.pages import ROOT
from tests.support.tiers import in_one_test

FOLDERS = ("agent", "world", "operator", "orchestrator")
CODE = [file for folder in (*FOLDERS, "docs", "examples", "tests", ".ci") for file in (ROOT / folder).rglob("*")]
FILES = {f"/{file.relative_to(ROOT)}" for file in (*CODE, *ROOT.iterdir()) if "__pycache__" not in file.parts}
PAGES = sorted(
    file for pattern in ("*.md", "docs/*.md", "docs/api/*.md", "agent/**/*.md") for file in ROOT.glob(pattern)
)
PATH = re.compile(
    r"(?:agent|world|operator|orchestrator)/deltaswarm_[\w./-]*|(?:docs|tests|\.ci)/[\w./-]*|[\w./-]+\.py"
)
"""A path from the root of the repository, or the name or the end of the path of a file of Python."""
MODULE = re.compile(r"(deltaswarm_[a-z0-9_]+(?:\.[a-z0-9_]+)*)(?:\.[A-Z]\w*|:\w+)*")
HISTORY = "CHANGELOG.md"
"""Names what there was at the time."""
THE_READERS = {"fog.py", "wind.py", "sluggish.py", "patient.py"}
"""Files that a page asks its reader to write."""


@in_one_test("page", PAGES)
def test_the_files_that_a_page_names_exist(page: Path) -> None:
    """In backticks: paths from the root, and the ends of paths of Python's files."""
    if page.name == HISTORY:
        return
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    spans = re.findall(r"`([^`\n]+)`", text)
    paths = {span.rstrip("/") for span in spans if PATH.fullmatch(span)} - THE_READERS
    assert sorted(path for path in paths if not any(file.endswith(f"/{path}") for file in FILES)) == []
    modules = {found[1] for span in spans if (found := MODULE.fullmatch(span))}
    assert sorted(module for module in modules if not exists(module)) == []


def exists(module: str) -> bool:
    """Whether there is this module or package, or a module of which the last part is a name."""
    path = module.replace(".", "/")
    ends = (f"/{path}", f"/{path}.py", f"/{path.rpartition('/')[0]}.py", f"/{path.rpartition('/')[0]}/__init__.py")
    return any(f"/{folder}{end}" in FILES for folder in FOLDERS for end in ends)
