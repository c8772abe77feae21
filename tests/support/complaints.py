"""What is said of mistakes in settings: keys and values, whatever the wording."""

import re
from typing import Any

import pytest

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import SettingsError, load

Printed = pytest.CaptureFixture[str]


def mistakes(table: Any, cls: type[Any] = Scenario) -> list[tuple[str, str]]:
    """The keys of the mistakes in a table, and what was found."""
    with pytest.raises(SettingsError) as caught:
        load(cls, table)
    return [(problem.path, problem.given) for problem in caught.value.problems]


def names(line: str, said: str) -> bool:
    """Whether an error names a key and, where `said` is `key: value`, the value that was found."""
    path, _, found = said.partition(": ")
    return re.match(rf"(deltaswarm: )?{re.escape(path)}(:? |$)", line) is not None and found in line
