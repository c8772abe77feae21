"""The page of failures: each row names the test that shows it, and that test is there."""

import re
from collections import Counter
from pathlib import Path

from tests.support.tiers import in_one_test

ROOT = Path(__file__).parents[2]
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in (ROOT / "docs" / "FAILURES.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| ---") and not line.endswith("| test |")
]
FUNCTIONS = Counter(
    name
    for file in (ROOT / "tests").rglob("test_*.py")
    for name in re.findall(r"^ *def (test_\w+)\(", file.read_text(encoding="utf-8"), re.MULTILINE)
)


@in_one_test("row", ROWS)
def test_a_row_names_one_test_that_exists(row: list[str]) -> None:
    """What is claimed is shown, and a test that is renamed is renamed here too."""
    assert len(row) == 3
    assert FUNCTIONS[f"test_{row[2].strip(' `|')}"] == 1
