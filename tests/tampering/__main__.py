"""`python -m tests.tampering --places 2000 --seed 1`: change stored results; exit code 1 if a change is not seen."""

import argparse
import tempfile
from pathlib import Path

from tests.tampering.changes import CRASHED, FOUND_BY_READER, HARMLESS, REFUSED, SILENT, judge
from tests.tampering.stores import make_all


def main() -> int:
    """Make stored results, change them, and print the counts by kind."""
    parser = argparse.ArgumentParser(prog="python -m tests.tampering", description=__doc__)
    parser.add_argument("--places", type=int, default=2000, metavar="N", help="how many (default: 2000)")
    parser.add_argument("--seed", type=int, default=1, help="all changes come from it (default: 1)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tampering-") as name:
        counts, wrong = judge(make_all(Path(name)), arguments.places, arguments.seed)
    verdicts = (REFUSED, FOUND_BY_READER, HARMLESS, SILENT, CRASHED)
    print(f"{'kind':12}", *(f"{verdict:>9}" for verdict in verdicts))
    for kind, count in counts.items():
        print(f"{kind:12}", *(f"{count[verdict]:9}" for verdict in verdicts))
    print("\n".join(wrong))
    return bool(wrong)


raise SystemExit(main())
