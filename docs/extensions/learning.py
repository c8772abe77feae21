"""Write the table of rewards in docs/LEARNING.md from the code."""

import re
from pathlib import Path

from deltaswarm_learn.rewards import REWARDS

PAGE = Path(__file__).parents[1] / "LEARNING.md"


def with_rewards(page: str) -> str:
    """Return the page with the table as it is now."""
    rows = [f"| `{name}` | {'-' if sign < 0 else '+'} | {meaning} |" for name, (sign, meaning) in REWARDS.items()]
    table = "\n".join(
        ["<!-- rewards -->", "| name | sign | counts |", "| --- | --- | --- |", *rows, "<!-- /rewards -->"]
    )
    return re.sub(r"<!-- rewards -->.*<!-- /rewards -->", lambda _: table, page, flags=re.DOTALL)


if __name__ == "__main__":
    PAGE.write_text(with_rewards(PAGE.read_text()))
