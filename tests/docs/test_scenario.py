"""The pages that are made from the code are what the code makes."""

from pathlib import Path

from docs.extensions import api, architecture, branch_keys, page_messages, published
from docs.extensions.command_line import reference as commands
from docs.extensions.results import PARTS, with_parts
from docs.extensions.scenario_keys import reference

from tests.support.tiers import in_one_test

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_of_scenario_keys_is_up_to_date() -> None:
    """docs/SCENARIO.md is what `reference` writes: every key, default, meaning and source."""
    assert (DOCS / "SCENARIO.md").read_text() == reference()


def test_the_lists_of_metrics_and_columns_are_up_to_date() -> None:
    """Every key of the summary, metric of a study and column of a table about a person is on its page."""
    for name in PARTS:
        page = (DOCS / name).read_text()
        assert page == with_parts(name, page)


def test_what_pages_tell_of_studies_is_what_was_published() -> None:
    """Findings that still hold, and medians as the tables have them."""
    for page in published.PAGES:
        text = page.read_text()
        assert text == published.with_published(text)


def test_the_page_of_messages_and_their_types_are_up_to_date() -> None:
    page = (DOCS / "STATION.md").read_text()
    assert page == page_messages.with_tables(page)
    assert page_messages.TYPES.read_text() == page_messages.types()


def test_the_page_of_commands_is_up_to_date() -> None:
    """docs/COMMANDS.md has the usage and every option of every command, whatever the terminal."""
    assert (DOCS / "COMMANDS.md").read_text() == commands()


def test_the_lists_of_packages_and_files_are_up_to_date() -> None:
    """docs/ARCHITECTURE.md has every file of every package, with what its first line says."""
    page = (DOCS / "ARCHITECTURE.md").read_text()
    assert page == architecture.with_lists(page)
    rooms = architecture.CORE | architecture.EXTENSIONS
    files = {file.name for name, folder in rooms.items() for file in (DOCS.parent / folder / name).rglob("*.py")}
    assert len(files) > 100
    assert not {name for name in files - {"__init__.py"} if f"| `{name}` | " not in page}


def test_the_table_of_keys_that_may_differ_in_a_branch_is_up_to_date() -> None:
    page = (DOCS / "BRANCHES.md").read_text()
    assert page == branch_keys.with_keys(page)


@in_one_test("page", sorted((DOCS / "api").glob("*.md")))
def test_the_pages_of_the_api_are_up_to_date(page: Path) -> None:
    """docs/api/ has every public name of its modules, with signature, fields and docstring."""
    assert page.read_text() == api.with_modules(page.read_text())
