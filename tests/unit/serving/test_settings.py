"""When people may begin, and what the table `[serve]` must say of it."""

from pathlib import Path

import pytest

from deltaswarm_serving.hosting import Plan
from deltaswarm_serving.line import Line
from deltaswarm_serving.settings import ServeSettings
from deltaswarm_serving.study import Study
from deltaswarm_sessions.links import Links
from deltaswarm_sessions.settings import load_session
from tests.support.sessions import a_file


@pytest.mark.parametrize(
    ("opens", "closes", "why"),
    [
        ("", "", ""),
        ("2999-01-01T00:00+01:00", "", "early"),
        ("2020-01-01T00:00Z", "2999-01-01T00:00Z", ""),
        ("", "2020-01-01T00:00+01:00", "late"),
    ],
)
def test_people_begin_between_two_moments(tmp_path: Path, opens: str, closes: str, why: str) -> None:
    settings, _ = load_session(str(a_file(tmp_path)))
    study = Study(settings, ServeSettings(opens=opens, closes=closes), Plan(tmp_path, tmp_path), Links(), Line(1))
    assert study.why_closed() == why
    study.admits = False
    assert study.why_closed() == "paused"
    study.has_doors = False  # as in the lab, whatever the disk and the clock say
    assert study.why_closed() == ""


@pytest.mark.parametrize("told", ["tomorrow", "2026-12-01T08:00", "08:00+01:00"])
def test_a_moment_has_a_date_and_an_offset(told: str) -> None:
    [problem] = ServeSettings(opens=told).problems()
    assert problem.path == "opens"
