"""Make the table of docs/BRANCHES.md: which keys of a scenario may differ in a branch, and why others may not."""

from collections.abc import Iterator
from pathlib import Path

from deltaswarm_branches.keys import RULES

PAGE = Path(__file__).parents[1] / "BRANCHES.md"
BEGIN, END = "<!-- keys -->\n", "<!-- /keys -->\n"


def keys() -> Iterator[str]:
    """Describe every rule: those about keys that may differ first."""
    yield from ("| keys | may differ | |", "| --- | --- | --- |")
    for rule in sorted(RULES, key=lambda rule: not rule.may_differ):
        yield f"| `{rule.prefix}` | {'yes' if rule.may_differ else 'no'} | {rule.why} |"


def with_keys(page: str) -> str:
    """Return the page with its table as it is now."""
    before, rest = page.split(BEGIN)
    return before + BEGIN + "\n".join(keys()) + "\n\n" + END + rest.split(END)[1]


if __name__ == "__main__":
    text = PAGE.read_text()
    if (made := with_keys(text)) != text:
        PAGE.write_text(made)
