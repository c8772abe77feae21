"""The paper's five figures, each from the sweep's tables, with its caption and its command."""

from collections.abc import Callable

import pandas as pd
from matplotlib.figure import Figure

from deltaswarm_orchestrator.analysis.report import Picture
from deltaswarm_orchestrator.figures import paper
from deltaswarm_orchestrator.figures.boxes import boxes
from deltaswarm_orchestrator.figures.messages import messages
from deltaswarm_orchestrator.figures.over_time import over_time
from deltaswarm_orchestrator.figures.snapshot import EARLY_S, EARLY_SEED, snapshot
from deltaswarm_orchestrator.figures.swarm import swarm
from deltaswarm_orchestrator.reproduction.conditions import DECENTRALISED, FIGURES, HIERARCHICAL, HYBRID, Extent
from deltaswarm_orchestrator.run.scenario import load_scenario


def picture(number: int, extent: Extent, table: pd.DataFrame, series: pd.DataFrame) -> Picture:
    """One of the paper's figures, 1 to 5.

    Raises:
        ValueError: the tables lack what it shows.
    """
    drawing, caption = DRAWN[number](table, series)
    command = f"deltaswarm reproduce --{extent.name} --figure {number}"
    return Picture(drawing, f"figure-{number}", f"The paper's figure {number}. {caption}", command)


def _swarm(table: pd.DataFrame, series: pd.DataFrame) -> tuple[Figure, str]:
    modes = {DECENTRALISED: "decentralised", HIERARCHICAL: "hierarchical", HYBRID: "hybrid"}
    shots = {
        label: snapshot(load_scenario("paper-25", [f"control.mode={mode}", "record=off"], EARLY_SEED))
        for label, mode in modes.items()
    }
    caption = (
        f"A swarm of 25 agents after {EARLY_S:.0f} s under each kind of control (seed {EARLY_SEED}). Black dots "
        "are events that are not complete; the shade is the density of events, the dotted line holds 95 % of it."
    )
    return swarm(shots), caption


def _waiting(table: pd.DataFrame, series: pd.DataFrame) -> tuple[Figure, str]:
    drawing = boxes(table, variants=FIGURES[2], paper=paper.WAITING_TIME_S)
    return drawing, "Mean waiting time of events per replicate, 25 agents; beside each box the paper's median and IQR."


def _in_trees(table: pd.DataFrame, series: pd.DataFrame) -> tuple[Figure, str]:
    drawing = over_time(series, variants=FIGURES[3], references={"paper: 12": 12.0, "paper: 33": 33.0})
    caption = (
        "Mean number of agents in trees over time, hybrid control with delta 3, 25 agents (hybrid 3) and 100 agents "
        "with both readings of the events' covariance [m²] and rate; bands are 95 % bootstrap intervals of the mean."
    )
    return drawing, caption


def _ablation(table: pd.DataFrame, series: pd.DataFrame) -> tuple[Figure, str]:
    drawing = boxes(table, variants=FIGURES[4], paper=paper.ABLATION_WAITING_TIME_S)
    return drawing, "Ablations: mean waiting time per replicate of the hybrid swarm without one of its elements."


def _messages(table: pd.DataFrame, series: pd.DataFrame) -> tuple[Figure, str]:
    caption = (
        "Messages to the operator against messages within the swarm (frames sent), a point per replicate, ellipses of "
        "one standard deviation around the mean."
    )
    return messages(table, variants=FIGURES[5]), caption


DRAWN: dict[int, Callable[[pd.DataFrame, pd.DataFrame], tuple[Figure, str]]] = {
    1: _swarm,
    2: _waiting,
    3: _in_trees,
    4: _ablation,
    5: _messages,
}
