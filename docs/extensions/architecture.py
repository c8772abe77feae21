"""Make the lists of docs/ARCHITECTURE.md: the packages and what they import, and every file with its first line."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]

CORE = {
    "deltaswarm_wire": "agent",
    "deltaswarm_scenario": "agent",
    "deltaswarm_cli": "orchestrator",
    "deltaswarm": "orchestrator",
    "deltaswarm_orchestrator": "orchestrator",
    "deltaswarm_world": "world",
    "deltaswarm_agent": "agent",
    "deltaswarm_operator": "operator",
}
EXTENSIONS = {
    "deltaswarm_studies": "orchestrator",
    "deltaswarm_sessions": "orchestrator",
    "deltaswarm_branches": "orchestrator",
    "deltaswarm_cluster": "orchestrator",
    "deltaswarm_learn": "orchestrator",
    "deltaswarm_dense": "orchestrator",
    "deltaswarm_field": "orchestrator",
    "deltaswarm_board": "agent",
    "deltaswarm_ros2": "agent",
    "deltaswarm_physics": "world",
}
"""Folder by package, in the order of a run: what all share, then who starts the run, then who takes part."""

ORDER = ("scenarios", "run", "processes", "base", "core", "inbox", "io", "station", "recording", "results")
"""Folders of a package in the order of a run; other folders follow."""

JOINS = tuple(f"deltaswarm_orchestrator/run/{name}.py" for name in ("in_process", "bounds", "checkpoints"))
"""The files that join the cores of several parts in one process."""


def packages() -> Iterator[str]:
    """Describe every package: whether it is core, what it does, and which other packages it imports."""
    yield from ("| package | kind | what it does | imports |", "| --- | --- | --- | --- |")
    for kind, rooms in (("core", CORE), ("extension", EXTENSIONS)):
        for name, folder in rooms.items():
            package = ROOT / folder / name
            imported = ", ".join(f"`{other}`" for other in imports(package))
            cells = (f"`{folder}/{name}`", kind, first_line(package / "__init__.py"), imported)
            yield "".join(f"| {cell} " if cell else "| " for cell in cells) + "|"


def imports(package: Path) -> list[str]:
    """Return the other packages that a package imports, apart from the files that join the parts."""
    found = set()
    for file in package.rglob("*.py"):
        if file.as_posix().endswith(JOINS):
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module.partition(".")[0])
    return [name for name in (*CORE, *EXTENSIONS) if name in found and name != package.name]


def files() -> Iterator[str]:
    """List every file of every package, folder by folder, with the first line of its docstring."""
    for name, folder in (CORE | EXTENSIONS).items():
        yield from ("", f"### `{folder}/{name}`")
        for below in sorted((ROOT / folder / name).rglob("__init__.py"), key=place):
            modules = sorted(file for file in below.parent.glob("*.py") if file != below)
            inner = below.parent.relative_to(ROOT / folder / name).as_posix()
            if modules:
                about = "" if inner == "." else f"**`{inner}/`**: {first_line(below)}"
                yield from ("", about, "") if about else ("",)
                yield from ("| file | what it does |", "| --- | --- |")
                yield from (f"| `{file.name}` | {first_line(file)} |" for file in modules)


def place(init: Path) -> tuple[tuple[int, str], ...]:
    """Return where a folder stands in its package."""
    package = next(parent for parent in init.parents if parent.name in CORE | EXTENSIONS)
    parts = init.parent.relative_to(package).parts
    return tuple((ORDER.index(part) if part in ORDER else len(ORDER), part) for part in parts)


def first_line(file: Path) -> str:
    """Return the first line of a file's docstring, for a cell of a table."""
    return (ast.get_docstring(ast.parse(file.read_text())) or "").partition("\n")[0].replace("|", r"\|")


def with_lists(page: str) -> str:
    """Return the page with its lists as they are now, each between marks `<!-- NAME -->` and `<!-- /NAME -->`."""
    for mark, lines in (("packages", packages()), ("files", files())):
        begin, end = f"<!-- {mark} -->\n", f"<!-- /{mark} -->\n"
        before, rest = page.split(begin)
        page = before + begin + "\n".join(lines).strip() + "\n\n" + end + rest.split(end)[1]
    return page


if __name__ == "__main__":
    PAGE = ROOT / "docs" / "ARCHITECTURE.md"
    PAGE.write_text(with_lists(PAGE.read_text()))
