"""GitHub's Markdown: what is plain text stays plain text."""

import re
from collections.abc import Sequence

_SPECIAL = re.compile(r"[\\*<>|~$]|](?=[(\[:])|&(?=[#\w])|(?<!\w)_|_(?!\w)")
"""A bracket alone, as around a unit, makes no link."""

_LINE_START = re.compile(r"^(\d*)(?=#|[-+](?:[-\s]|$)|[.)](?:\s|$))")
"""What would make a heading, a list, a rule or a numbered item; a negative number does not."""


def text(plain: str) -> str:
    """One paragraph: whitespace is folded, `backticks` set code, the rest means nothing to Markdown."""
    return _LINE_START.sub(r"\1\\", _inline(plain))


def _inline(plain: str) -> str:
    pieces = " ".join(plain.split()).split("`")
    if len(pieces) % 2 == 0:  # one backtick without its partner is only a character
        return "\\`".join(_escaped(piece) for piece in pieces)
    return "".join(code(piece) if index % 2 else _escaped(piece) for index, piece in enumerate(pieces))


def _escaped(plain: str) -> str:
    return _SPECIAL.sub(r"\\\g<0>", plain)


def code(plain: str) -> str:
    """Inline code; also of text that holds backticks."""
    fence = "`" * (_longest_run(plain) + 1)
    room = " " if plain.startswith("`") or plain.endswith("`") else ""
    return f"{fence}{room}{plain}{room}{fence}"


def fenced(plain: str) -> str:
    """Lines to type."""
    fence = "`" * max(3, _longest_run(plain) + 1)
    return f"{fence}sh\n{plain}\n{fence}"


def _longest_run(plain: str) -> int:
    return max((len(run) for run in re.findall("`+", plain)), default=0)


def table(titles: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[bool]) -> str:
    """A table, its numbers flush right."""
    rules = ["---:" if is_numeric else "---" for is_numeric in numeric]
    lines = [[_in_cell(title) for title in titles], rules, *([_in_cell(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _in_cell(plain: str) -> str:
    # Within a table a bar ends the cell even in code.
    return _inline(plain).replace("\\|", "|").replace("|", "\\|")


def notes(lines: Sequence[str], *, is_warning: bool) -> str:
    """A box on GitHub, a quotation elsewhere."""
    kind = "WARNING" if is_warning else "NOTE"
    return "\n".join([f"> [!{kind}]", *(f"> - {text(line)}" for line in lines)])


def picture(alternative: str, path: str) -> str:
    """A picture by its path."""
    alternative = re.sub(r"(?<!\\)([\[\]])", r"\\\1", _inline(alternative.replace("`", "")))
    return f"![{alternative}](<{path}>)" if re.search(r"[\s()]", path) else f"![{alternative}]({path})"
