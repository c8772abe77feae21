"""Paths that a user gives."""

from pathlib import Path

import pytest

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_orchestrator.cli import main
from tests.support.complaints import Printed


def test_no_page_is_written_among_other_things(tmp_path: Path, capsys: Printed) -> None:
    """A new or empty folder, and one of a study or sweep, is well; another is refused, since files would be lost."""
    for folder in (tmp_path, tmp_path / "new"):
        check_out(folder, ["provenance.csv"])
    (tmp_path / "page.md").touch()
    with pytest.raises(CommandError, match=str(tmp_path)):
        check_out(tmp_path, ["provenance.csv"])
    assert main(["study", "lose-the-roots", "--dry-run", "--out", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err
    (tmp_path / "provenance.csv").touch()
    check_out(tmp_path, ["provenance.csv"])
