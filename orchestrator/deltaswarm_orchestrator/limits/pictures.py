"""The experiments' figures: waiting and messages against the limit, and over time where it comes and goes."""

from collections.abc import Iterator

import pandas as pd
from matplotlib.figure import Figure

from deltaswarm_orchestrator.analysis.report import Picture
from deltaswarm_orchestrator.figures.lines import lines
from deltaswarm_orchestrator.figures.over_time import over_time
from deltaswarm_orchestrator.limits.experiments import MODES, Experiment
from deltaswarm_orchestrator.limits.findings import Findings
from deltaswarm_orchestrator.limits.runs import BIN_S, IN_TREES, MESSAGES, WAITING

LABELS = {
    WAITING: "mean waiting time [s]",
    MESSAGES: "messages to the operator [1/s]",
    IN_TREES: "agents in trees",
}
SHOWN = {WAITING: "Waiting time", MESSAGES: "Messages to the operator", IN_TREES: "Agents in trees"}
FILES = {WAITING: "waiting", MESSAGES: "messages", IN_TREES: "in-trees"}


def command(experiment: Experiment) -> str:
    """What makes an experiment's figures."""
    return f"deltaswarm limits {experiment.name}"


def pictures_of(experiment: Experiment, found: Findings, *, blank: bool = False) -> Iterator[Picture]:
    """An experiment's figures; `blank` leaves the drawings empty, for who wants the words only."""
    if experiment.axis:
        for measure in (WAITING, MESSAGES):
            if blank or _has_values(experiment, found, measure):
                drawing = Figure() if blank else _against_the_limit(experiment, found, measure)
                caption = f"{SHOWN[measure]} against {experiment.axis}: medians with their 95 % intervals."
                yield Picture(drawing, f"{experiment.name}-{FILES[measure]}", caption, command(experiment))
    if experiment.fault is None:
        return
    stays = experiment.fault.until_s is None
    for measure in (WAITING, MESSAGES, *([IN_TREES] if stays else [])):
        rows = pd.DataFrame() if blank else _over_time_rows(experiment, found, measure)
        if blank or not rows.empty:
            drawing = Figure() if blank else _over_time(experiment, rows, measure)
            caption = (
                f"{SHOWN[measure]} over time, {experiment.hardest.words}: means over the replicates with their 95 % "
                f"intervals, by windows of {BIN_S:g} s"
                f"{', of the events that arrived in each' if measure == WAITING else ''}."
            )
            name = f"{experiment.name}-{FILES[measure]}-over-time"
            yield Picture(drawing, name, caption, command(experiment))


def _has_values(experiment: Experiment, found: Findings, measure: str) -> bool:
    return bool(_estimates(experiment, found, measure)["value"].notna().all())


def _estimates(experiment: Experiment, found: Findings, measure: str) -> pd.DataFrame:
    rows = found.estimates
    rows = rows[(rows["experiment"] == experiment.name) & (rows["measure"] == measure)]
    return rows.assign(limit=[experiment.level(str(label)).value for label in rows["level"]])


def _against_the_limit(experiment: Experiment, found: Findings, measure: str) -> Figure:
    rows = _estimates(experiment, found, measure)
    return lines(rows, "limit", experiment.axis, LABELS[measure], group="mode", groups=MODES)


def _over_time_rows(experiment: Experiment, found: Findings, measure: str) -> pd.DataFrame:
    """The windows of the hardest level, by mode, of the modes that have any value."""
    rows = found.windows
    rows = rows[(rows["experiment"] == experiment.name) & (rows["level"] == experiment.hardest.label)]
    known = set(rows.loc[rows[measure].notna(), "mode"])
    return rows[rows["mode"].isin(known)].assign(variant=rows["mode"])


def _over_time(experiment: Experiment, rows: pd.DataFrame, measure: str) -> Figure:
    assert experiment.fault is not None
    modes = [mode for mode in MODES if mode in set(rows["mode"])]
    return over_time(
        rows,
        measure,
        LABELS[measure],
        variants=modes,
        fault_s=experiment.fault.from_s,
        fault_until_s=experiment.fault.until_s,
    )
