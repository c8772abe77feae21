"""The language of the station's page: a scenario has it, mistakes in its file are told, a file to translate is made."""

import json
import tomllib
from hashlib import sha256
from pathlib import Path

import pytest

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import CONDUCTOR_KIND, LIVE, page_hello
from deltaswarm_operator.core.intents import carry_out
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.page_language import LanguageSettings, page_texts, placeholders
from deltaswarm_scenario.scenario import Scenario, scenario_digest
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.settings import load_session
from deltaswarm_sessions.translation import main
from deltaswarm_wire.checked import SettingsError

LANGUAGE = """
schema = 1
tag = "fr"
[page]
"{count} unread" = "{count} non lus"
"Inbox" = ""
[run]
"Do you agree?" = "Êtes-vous d'accord ?"
"""
SESSION = """
schema = 1
[session]
language = "fr.toml"
[[session.condition]]
label = "A"
scenario = "smoke"
[[session.form]]
name = "you"
question = [{ name = "age", text = "How old are you?", kind = "number" }]
"""


def told(scenario: Scenario) -> dict[str, str]:
    language = scenario.operator.page.language.told
    return {} if language is None else language["texts"]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A language's file beside a scenario that names it."""
    (tmp_path / "fr.toml").write_text(LANGUAGE, encoding="utf-8")
    (tmp_path / "mine.toml").write_text('schema = 1\n[operator.page]\nlanguage = "fr.toml"\n')
    return tmp_path / "mine.toml"


def test_a_scenario_has_what_the_file_says(file: Path, tmp_path: Path) -> None:
    """Also where it is saved and loaded elsewhere; the digest depends on the texts, not on the file's name."""
    scenario = load_scenario(str(file))
    assert told(scenario)["{count} unread"] == "{count} non lus"
    assert "Inbox" not in told(scenario)
    copy = tmp_path / "copy" / "scenario.toml"
    copy.parent.mkdir()
    copy.write_text(to_toml(scenario), encoding="utf-8")
    (tmp_path / "fr.toml").unlink()
    again = load_scenario(str(copy))
    assert again == scenario
    assert scenario_digest(again) == scenario_digest(scenario)
    assert told(load_scenario(str(copy), ["operator.page.language=de"]))["Map"] == "Karte"
    assert told(load_scenario(str(copy), ["operator.page.language="])) == {}
    assert load_scenario("smoke").operator.page.language.told is None


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ('"{count} unred" = "{count}"', "did you mean '{count} unread'?"),
        ('"My own text" = "x"', "a text of your own belongs in the table run"),
        ('"{count} unread" = "non lus"', "must have {count}"),
        ('"Inbox" = "{n}"', "must have no placeholder"),
        ('"Inbox" = 3', "must be a string"),
    ],
)
def test_mistakes_are_told_when_the_scenario_is_loaded(tmp_path: Path, line: str, hint: str) -> None:
    file = tmp_path / "x.toml"
    file.write_text(f"schema = 1\n[page]\n{line}\n")
    with pytest.raises(SettingsError) as error:
        load_scenario("smoke", [f"operator.page.language={file}"])
    [problem] = error.value.problems
    assert problem.path.startswith("operator.page.language.page")
    assert hint in str(problem)


def test_a_file_that_is_not_there_is_told() -> None:
    with pytest.raises(SettingsError, match="must be a TOML file or one of de"):
        load_scenario("smoke", ["operator.page.language=xx.toml"])


def test_the_texts_have_no_two_values_of_one_name() -> None:
    """A value could else not be found in what the operator says."""
    for text in page_texts():
        assert text.count("{") == len(placeholders(text)), text


def test_german_is_complete(capsys: pytest.CaptureFixture[str]) -> None:
    """So it can be taken as an example, and the file to translate shows nothing that is missing."""
    assert main("smoke", "operator.page.language=de") == 0
    table = tomllib.loads(capsys.readouterr().out)
    assert list(table["page"]) == list(page_texts())
    assert [text for text, translation in table["page"].items() if not translation] == []
    assert table["tag"] == "de"


def test_a_session_has_one_language(tmp_path: Path, capsys: pytest.CaptureFixture[str], file: Path) -> None:
    """It is in the session's folder, for all runs; the file to translate has the texts of its forms."""
    session = tmp_path / "session.toml"
    session.write_text(SESSION)
    runs = plan(load_session(str(session))[0], 1, tmp_path)
    assert {told(run.scenario)["{count} unread"] for run in runs} == {"{count} non lus"}
    assert main(str(session)) == 0
    table = tomllib.loads(capsys.readouterr().out)
    assert table["page"]["{count} unread"] == "{count} non lus"
    assert table["run"]["How old are you?"] == ""
    assert main(str(tmp_path / "none.toml")) == 2


def test_the_conductor_reads_english_and_consent_is_what_was_read(file: Path) -> None:
    settings = ["operator.probes.consent='Do you agree?'", "operator.probes.participant=P1"]
    console = Console(load_scenario(str(file), settings).for_operator((), 1.0))
    assert page_hello(console, "a run", LIVE)["language"]["tag"] == "fr"
    assert page_hello(console, "a run", CONDUCTOR_KIND)["language"] is None
    console.start(0.0)
    sheet = {"type": "sheet", "from": 1, "consent": True, "participant": "P1", "condition": ""}
    assert carry_out(console, json.dumps(sheet).encode(), 1.0) == []
    [action] = console.actions
    assert action.text is not None
    assert sha256("Êtes-vous d'accord ?".encode()).hexdigest() in action.text


def test_a_run_of_an_older_version_can_be_loaded() -> None:
    assert not LanguageSettings("de", {"Outbox": "Postausgang"}).problems()


def test_a_language_that_says_nothing_is_english() -> None:
    assert LanguageSettings("", {"Inbox": ""}).told is None
