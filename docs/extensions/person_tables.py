"""Make the part of docs/RESULTS.md about the tables of a person at the console, from their rows."""

import sys
from pathlib import Path

from deltaswarm_scenario.person_tables import TABLES, columns_of

BEGIN, END = "<!-- person -->\n", "<!-- /person -->\n"


def with_reference(page: str) -> str:
    """Return the page with the present tables between its marks."""
    before, rest = page.split(BEGIN)
    return before + BEGIN + reference() + END + rest.split(END)[1]


def reference() -> str:
    """Describe every column of every table."""
    lines = []
    for name, table in TABLES.items():
        about = (table.__doc__ or "").partition(", in ")[0]
        lines += [
            "",
            f"## `{name}.csv`: {about[0].lower()}{about[1:]}",
            "",
            "| column | unit | meaning |",
            "| --- | --- | --- |",
        ]
        lines += [f"| `{column}` | {unit} | {meaning} |" for column, (_, (unit, meaning)) in columns_of(table).items()]
    return "\n".join(lines) + "\n\n"


if __name__ == "__main__":
    page = Path(sys.argv[1])
    page.write_text(with_reference(page.read_text()))
