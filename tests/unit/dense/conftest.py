"""For tests of the dense engine: it is compiled by one worker, and the others wait for it."""

import pytest

from deltaswarm_dense.compiled import compile_once
from deltaswarm_dense.engine import run_dense
from deltaswarm_scenario.scenario import Scenario


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    compile_once("dense engine", lambda: run_dense(Scenario()))
