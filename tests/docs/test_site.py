"""The documentation site: it builds without a warning, and its reference pages hold what the code has."""

import json
import re
import subprocess
from pathlib import Path

import pytest
import yaml

from deltaswarm_wire import __version__
from tests.support.pages import ROOT, commands, shell


def build(out: Path, options: str = "") -> subprocess.CompletedProcess[str]:
    """Build the site by the command that CONTRIBUTING.md gives, with more options."""
    [command] = [line for line in commands((ROOT / "CONTRIBUTING.md").read_text()) if line.startswith("sphinx-build")]
    assert {"-n", "-W", "--keep-going"} <= set(command.split()), "broken links and other warnings are errors"
    done = shell(command.replace("build/site", f"{out} {options}"), ROOT)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, with the notebooks as they are kept."""
    out = tmp_path_factory.mktemp("docs") / "site"
    assert not build(out, "-D nb_execution_mode=off").stderr
    return out


@pytest.mark.slow
def test_the_notebooks_are_run_into_the_site(tmp_path: Path) -> None:
    build(tmp_path / "site")
    pages = sorted((tmp_path / "site" / "docs" / "notebooks").iterdir())
    assert len(pages) == 3
    for page in pages:
        text = page.read_text()
        assert 'class="cell_output' in text, page
        assert "../../_images/" in text, page
        assert '<table border="1" class="dataframe' in text or "<table id=" in text, page


def test_every_page_is_in_the_site(site: Path) -> None:
    """Every page and notebook of docs/, and every page about the agent."""
    sources = [*(ROOT / "docs").rglob("*.md"), *(ROOT / "docs" / "notebooks").glob("*.ipynb")]
    sources += (ROOT / "agent").rglob("*.md")
    assert len(sources) > 20
    for source in sources:
        assert (site / source.relative_to(ROOT)).with_suffix(".html").exists(), source


def test_the_first_page_leads_to_the_four_kinds_of_documentation(site: Path) -> None:
    """The newcomer's four pages, how-to guides, reference and explanation, and the published studies."""
    assert "docs/index.html" in (site / "index.html").read_text()
    first = (site / "docs" / "index.html").read_text()
    for caption in ("Start here", "How-to guides", "Reference", "Explanation", "Published studies"):
        assert f'<span class="caption-text">{caption}</span>' in first


def test_the_citation_is_of_this_version() -> None:
    """CITATION.cff and codemeta.json name the version that pip installs; the first also the paper's five authors."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (citation["version"], citation["license"]) == (__version__, "Apache-2.0")
    described = json.loads((ROOT / "codemeta.json").read_text())
    assert (described["version"], described["license"].rpartition("/")[2]) == (__version__, citation["license"])
    [paper] = citation["references"]
    assert paper["title"] in (ROOT / "README.md").read_text().replace("\n", " ")
    assert len(paper["authors"]) == 5


def test_the_files_to_read_first_exist() -> None:
    section = (ROOT / "docs" / "ARCHITECTURE.md").read_text().split("## Ten files")[1].split("\n## ")[0]
    paths = re.findall(r"^\d+\. `(\S+\.py)`", section, re.MULTILINE)
    assert len(set(paths)) == len(paths) == 10
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_warnings_of_pages_are_warnings(site: Path) -> None:
    """Not the marks by which a forge knows them."""
    page = (site / "docs" / "studies" / "budget" / "page.html").read_text()
    assert 'class="admonition warning"' in page
    assert "[!WARNING]" not in page
