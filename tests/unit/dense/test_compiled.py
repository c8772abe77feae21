"""The compiled code that the dense engine keeps on disk."""

from pathlib import Path

import pytest

from deltaswarm_dense import compiled


def test_a_folder_that_was_cleared_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As runs of newer versions do while a study of an older one goes on."""
    monkeypatch.setattr(compiled, "cache_folder", lambda: tmp_path / "cleared")
    done: list[str] = []
    for _ in range(2):
        compiled.compile_once("engine", lambda: done.append("compiled"))
    assert done == ["compiled"]
