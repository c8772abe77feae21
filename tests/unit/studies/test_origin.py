"""Where a study's files may be."""

from pathlib import Path

import pytest

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_studies.origin import check_folder


def test_no_page_is_written_among_other_things(tmp_path: Path) -> None:
    """A new or empty folder, and one of a study or sweep, is well; another is refused, since files would be lost."""
    for folder in (tmp_path, tmp_path / "new"):
        check_folder(folder)
    (tmp_path / "page.md").touch()
    with pytest.raises(CommandError, match=str(tmp_path)):
        check_folder(tmp_path)
    (tmp_path / "provenance.csv").touch()
    check_folder(tmp_path)
