"""Seal published tables that have no seal yet, as they are found: `python docs/extensions/seal_studies.py`.

The seal says since when it vouches for the tables, which is later than their runs. Tables that have a seal are checked.
"""

from datetime import UTC, datetime
from pathlib import Path

import pandas as pd

from deltaswarm_orchestrator.base import seal
from deltaswarm_studies.load import load_study
from deltaswarm_studies.origin import seal_tables, sealed_tables

STUDIES = Path(__file__).parents[1] / "studies"


def main() -> None:
    """Seal the tables of every published study."""
    for folder in sorted(file.parent for file in STUDIES.glob("*/runs.csv")):
        study = load_study(folder.name)
        if sealed_tables(folder, study):
            continue
        found = f"as found on {datetime.now(UTC):%Y-%m-%d}"
        provenance = pd.read_csv(folder / "provenance.csv", dtype=str, keep_default_na=False)
        seal_tables(study, provenance, folder, sorted(folder.glob("*.csv")), found)
        print(f"{folder / seal.RECORD}: {found}")


if __name__ == "__main__":
    main()
