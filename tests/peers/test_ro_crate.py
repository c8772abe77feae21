"""The metadata of published studies against RO-Crate's validator (extra `crate`), without the network."""

import io
import subprocess
import sys
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

requests = pytest.importorskip("requests")
requests_cache = pytest.importorskip("requests_cache", reason="needs RO-Crate's validator: pip install -e '.[crate]'")
urllib3 = pytest.importorskip("urllib3")
pytest.importorskip("rocrate_validator", reason="needs RO-Crate's validator: pip install -e '.[crate]'")
pytest.importorskip("rocrate", reason="needs RO-Crate's context: pip install -e '.[crate]'")

ROOT = Path(__file__).parents[2]
CONTEXT = "https://w3id.org/ro/crate/1.1/context"
FOLDERS = sorted(file.parent for file in (ROOT / "docs" / "studies").glob("*/ro-crate-metadata.json"))


class Installed(requests.adapters.BaseAdapter):  # type: ignore[misc]
    """Answers with the context that the package `rocrate` brings: that of 1.1, up to version 0.10."""

    def send(self, request: Any, **options: Any) -> Any:
        text = files("rocrate").joinpath("data", "ro-crate.jsonld").read_bytes()
        assert CONTEXT.encode() in text
        headers: Mapping[str, str] = {"Content-Type": "application/ld+json"}
        answer = urllib3.HTTPResponse(io.BytesIO(text), headers, preload_content=False, status=200)
        return requests.adapters.HTTPAdapter().build_response(request, answer)

    def close(self) -> None:
        pass


@pytest.mark.slow
def test_what_is_published_is_a_valid_crate(tmp_path: Path) -> None:
    session = requests_cache.CachedSession(str(tmp_path / "cache"), "sqlite", expire_after=-1)
    session.mount(CONTEXT, Installed())
    assert session.get(CONTEXT).ok
    command = [str(Path(sys.executable).parent / "rocrate-validator"), "validate", "--no-paging", "--offline"]
    assert FOLDERS
    for folder in FOLDERS:
        options = ["--cache-path", str(tmp_path / "cache"), str(folder)]
        checked = subprocess.run([*command, *options], capture_output=True, text=True, timeout=300, check=False)
        assert checked.returncode == 0, checked.stdout
