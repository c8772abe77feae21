"""Make the pages docs/api/*.md from the sources: signatures, fields and docstrings of all that is public.

A page has marks `<!-- MODULE -->` or `<!-- MODULE: NAME, NAME -->`, each up to `<!-- / -->`.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "api"
PART = re.compile(r"<!-- (deltaswarm[\w.]+)(?:: ([\w, ]+))? -->\n.*?<!-- / -->\n", re.DOTALL)

Function = ast.FunctionDef | ast.AsyncFunctionDef


def with_modules(page: str) -> str:
    """Return a page with its modules as they are now."""

    def made(found: re.Match[str]) -> str:
        names = found[2].split(", ") if found[2] else None
        return "\n".join((found[0].splitlines()[0], described(found[1], names), "<!-- / -->", ""))

    return PART.sub(made, page)


def described(module: str, names: list[str] | None) -> str:
    """Describe a module: its docstring, and its public names, or these."""
    [file] = ROOT.glob(f"*/{module.replace('.', '/')}.py")
    text = file.read_text()
    tree = ast.parse(text)
    lines = [line for part in public(tree.body, text.splitlines(), names, 0) for line in (*part, "", "")]
    return "\n".join(["```python", *docstring(tree.body[0], text.splitlines()), "", *lines]).rstrip() + "\n```"


def public(body: list[ast.stmt], source: list[str], names: list[str] | None, depth: int) -> Iterator[list[str]]:
    """Yield the lines of each public function, class and constant of a module or class, without any code."""
    for node, after in zip(body, [*body[1:], ast.Pass()], strict=True):
        name = name_of(node)
        if (name.startswith("_") and name != "__call__") or not name or (names and name not in names):
            continue
        if isinstance(node, Function | ast.ClassDef):
            head = header(node, source)
            if isinstance(node, ast.ClassDef):
                for inner in public(node.body, source, None, depth + 1):
                    head += inner if is_field(inner) else ["", *inner]
            yield head
        else:
            text = docstring(after, source)
            if text or depth:
                yield source[node.lineno - 1 : node.end_lineno] + text


def is_field(lines: list[str]) -> bool:
    """Whether lines are those of a field, and not of a method."""
    return not lines[0].strip().startswith(("def ", "async def ", "class ", "@"))


def name_of(node: ast.stmt) -> str:
    """Return what a statement defines; empty: nothing."""
    if isinstance(node, Function | ast.ClassDef):
        return node.name
    target = (
        node.targets[0] if isinstance(node, ast.Assign) else node.target if isinstance(node, ast.AnnAssign) else None
    )
    return target.id if isinstance(target, ast.Name) else ""


def header(node: Function | ast.ClassDef, source: list[str]) -> list[str]:
    """Return the lines of a definition up to the end of its docstring."""
    first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
    start = node.body[0].lineno
    if isinstance(node.body[0], Function | ast.ClassDef) and node.body[0].decorator_list:
        start = node.body[0].decorator_list[0].lineno
    if start == node.lineno:  # a body on the same line
        return source[first - 1 : start]
    while not source[start - 2].split("#")[0].rstrip().endswith(":"):  # comments before the body
        start -= 1
    return source[first - 1 : start - 1] + docstring(node.body[0], source)


def docstring(node: ast.stmt, source: list[str]) -> list[str]:
    """Return the lines of a statement that is a text."""
    is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return source[node.lineno - 1 : node.end_lineno] if is_text else []


if __name__ == "__main__":
    for page in PAGES.glob("*.md"):
        page.write_text(with_modules(page.read_text()))
