"""Print a file in which the station's page can be translated, for a scenario or a session.

`python -m deltaswarm_sessions.translation FILE > LANGUAGE.toml`. What the scenario's language
translates already is filled in, so the same command shows what is missing.
"""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import tomli_w

from deltaswarm_orchestrator.scenarios import BUILT_IN, DEFAULT_SCENARIO
from deltaswarm_orchestrator.scenarios.load import load_scenario, read_toml
from deltaswarm_scenario.page_language import page_texts
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.settings import load_session
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.plugins import find_controller


def to_translate(scenarios: Iterable[Scenario]) -> str:
    """Return a language's file with all texts of the page and of these scenarios."""
    scenarios = list(scenarios)
    language = scenarios[0].operator.page.language
    page = page_texts()
    own = dict.fromkeys(text for scenario in scenarios for text in _own_texts(scenario) if text and text not in page)
    tables = {"page": {text: language.page.get(text, "") for text in page}}
    tables["run"] = {text: language.run.get(text, "") for text in own}
    return tomli_w.dumps({"schema": 1, "tag": language.tag, **tables})


def _own_texts(scenario: Scenario) -> Iterator[str]:
    operator = scenario.operator
    yield from (operator.page.title, operator.page.end_text, operator.probes.consent)
    for form in operator.probes.form:
        yield from (form.title or form.name, form.text)
        for question in form.question:
            yield from (question.text, question.low_text, question.high_text, *question.choices)
    for order in forms_of(find_controller(scenario.control.mode)):
        yield from (order.name, order.help)
        for argument in order.arguments:
            yield from (argument.help, *argument.choices)


def main(file: str = DEFAULT_SCENARIO, *overrides: str) -> int:
    """Print the file for a scenario, with `key=value` overrides, or for a session."""
    try:
        table, path = read_toml("scenario", file, BUILT_IN)
        if "session" in table and path is not None:
            scenarios = [run.scenario for run in plan(load_session(file)[0], 1, Path(file).parent)]
        else:
            scenarios = [load_scenario(file, overrides)]
    except SettingsError as error:
        print(error, file=sys.stderr)
        return 2
    print(to_translate(scenarios), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
