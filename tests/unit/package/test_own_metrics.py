"""Tests of a controller's own numbers, from its object to the tables of runs, sweeps and studies."""

from pathlib import Path

import pytest

import deltaswarm

MODULE = """
from deltaswarm_agent.controllers.potential import PotentialController
from deltaswarm_wire.controller_metrics import ControllerMetric


class Plain(PotentialController):
    pass


class Counts(PotentialController):
    Metrics = (
        ControllerMetric("agent", "number of the agent", "1"),
        ControllerMetric("asked", "percepts of an agent", per="run"),
        ControllerMetric("even_s", "time in even steps", "s"),
        ControllerMetric("never", "nothing"),
    )

    def __init__(self, context):
        super().__init__(context)
        self.asked, self.number = 0, context.agent

    def step(self, percept):
        self.asked += 1
        self.metrics = {"agent": self.number, "asked": self.asked, "never": None}
        if percept.step % 2 == 0:
            self.metrics["even_s"] = percept.time_s
        return super().step(percept)


class Undeclared(Counts):
    Metrics = ()


class Wrong(Counts):
    Metrics = (ControllerMetric("agent", "number of the agent"),)


class Unfit(PotentialController):
    Metrics = ("agent",)
"""

KEYS = {"run.duration_s": 40.0, "run.step_s": 2.0, "run.ask_every_step": True, "control.mode": "counting:Counts"}

STUDY = """
schema = 1
name = "own"
base = "smoke"
scenario.run.duration_s = 40.0
scenario.run.step_s = 2.0
scenario.run.ask_every_step = true
[sweep]
repeats = 8
prove = 0
series_every_s = 10.0
axes.control.mode = ["counting:Counts", "counting:Plain"]

[study]
question = "How often is an agent asked?"
window_s = 10.0
factors = { mode = "Control" }
metrics = ["controller.asked", "late_s"]

[[metric]]
name = "late_s"
kind = "window"
of = "controller.even_s"
from_s = 20.0
until_s = 40.0

[[claim]]
id = "asked"
text = "An agent is asked in each step."
kind = "value"
metric = "controller.asked"
of = "mode=counting:Counts"
within = [19.0, 21.0]

[[claim]]
id = "late"
text = "The mean over even steps of the second half."
kind = "value"
metric = "late_s"
of = "mode=counting:Counts"
within = [28.0, 30.0]

[[figure]]
name = "even"
kind = "time"
metric = "controller.even_s"
hue = "mode"
"""


CONTRAST = """
[[contrast]]
id = "asked"
text = "Both are asked as often."
factor = "mode"
reference = "mode=counting:Plain"
metrics = ["controller.asked"]
"""


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "counting.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)


def test_they_reach_summary_and_series() -> None:
    """Means over agents in each step; in the summary over the steps, or of the last; the digest stays."""
    run = deltaswarm.run("smoke", KEYS, seed=1, progress=False)
    assert run.summary["controller"] == {"agent": 2.5, "asked": 20.0, "even_s": 18.0, "never": None}
    assert list(run.series["controller_agent"]) == [2.5] * 20
    assert list(run.series["controller_asked"]) == list(range(1, 21))
    assert list(run.series["controller_even_s"].dropna()) == [4.0 * step for step in range(10)]
    assert run.series["controller_never"].isna().all()
    plain = deltaswarm.run("smoke", KEYS | {"control.mode": "counting:Undeclared"}, seed=1, progress=False)
    assert plain.digest == run.digest
    assert "controller" not in plain.summary
    assert not [name for name in plain.series if name.startswith("controller_")]
    assert deltaswarm.open(run.folder).summary["controller"] == run.summary["controller"]


@pytest.mark.processes
def test_processes_have_the_same_values() -> None:
    """In summary and series, with the same digest, and with a recorder that reads the truth."""
    runs = [deltaswarm.run("smoke", KEYS, seed=1, engine=by, progress=False) for by in ("in-process", "processes")]
    assert runs[0].digest == runs[1].digest
    assert runs[0].summary["controller"] == runs[1].summary["controller"]
    own = [run.series.filter(like="controller_") for run in runs]
    assert own[0].equals(own[1])


def test_wrong_ones_are_errors() -> None:
    """A wrong declaration before the run; an undeclared number as a failure of the agent."""
    with pytest.raises(deltaswarm.Error, match="must be a controller whose Metrics are a tuple of ControllerMetric"):
        deltaswarm.run("smoke", KEYS | {"control.mode": "counting:Unfit"})
    with pytest.warns(UserWarning, match="metrics must be declared in Metrics"):
        deltaswarm.run("smoke", KEYS | {"control.mode": "counting:Wrong"}, progress=False)


def test_they_reach_sweeps_studies_and_claims() -> None:
    """A column of the table, windows of the series, claims about both; a variant without them has none."""
    Path("own.toml").write_text(STUDY)
    with pytest.warns(UserWarning, match="own: "):
        study = deltaswarm.study("own.toml", jobs=1, progress=False)
    runs = study.runs.groupby("variant")
    assert list(runs.get_group("mode=counting:Counts")["controller.asked"]) == [20.0] * 8
    assert list(runs.get_group("mode=counting:Counts")["late_s"]) == [29.0] * 8  # 20, 24, 28 and 32, 36 s, by windows
    assert runs.get_group("mode=counting:Plain")["controller.asked"].isna().all()
    verdicts = dict(zip(study.claims["claim"], study.claims["verdict"], strict=True))
    assert verdicts == {"asked": "holds", "late": "holds"}
    assert "percepts of an agent" in study.page.read_text()
    assert set(study.evidence.courses["metric"]) == {"controller.even_s"}
    Path("own.toml").write_text(STUDY + CONTRAST)
    with pytest.raises(deltaswarm.Error, match="must be a column of the sweep's table; 'mode=counting:Plain' has none"):
        deltaswarm.study("own.toml")
