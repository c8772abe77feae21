"""The page: the answer first, then each experiment with its figures, tests and command."""

from collections.abc import Mapping

import pandas as pd

from deltaswarm_orchestrator.analysis import words
from deltaswarm_orchestrator.analysis.report import Block, Cell, Column, Command, Notes, Report, Section, Table
from deltaswarm_orchestrator.limits.answers import answer, loss_bar_in_words
from deltaswarm_orchestrator.limits.effects import LIMIT
from deltaswarm_orchestrator.limits.experiments import MODES, Experiment
from deltaswarm_orchestrator.limits.findings import Findings
from deltaswarm_orchestrator.limits.pictures import SHOWN, command, pictures_of
from deltaswarm_orchestrator.limits.recovery import TOLERANCE
from deltaswarm_orchestrator.limits.runs import BIN_S, IN_TREES, MEASURES, MESSAGES, WAITING
from deltaswarm_orchestrator.limits.sentences import (
    duration,
    effect_of,
    harm_in_words,
    paying_in_words,
    recovery_in_words,
    row_of,
    size,
    tested,
    too_few,
)

PER = {WAITING: " s", MESSAGES: " per s"}
UNITS = {WAITING: "s", MESSAGES: "1/s", IN_TREES: ""}

METHOD = (
    "Every experiment is a built-in sweep over the paper's 25 agents, in three control modes. Replicate r sees the "
    "same arrivals in every mode and at every level, so comparisons are paired: Wilcoxon's signed-rank test, Holm's "
    "correction within each experiment over the tests of one question and one measure, significant below 5 %. "
    "Estimates are medians over the replicates, ratios are those of medians; intervals are 95 % bootstrap intervals.",
    "Waiting time counts events that were never sensed to the end of the run; left out, as the paper does, they would "
    "flatter a swarm that never finds them.",
    "What is not significant is not shown to be so; that is no proof that there is no difference.",
    f"A swarm is back after a fault at the end of the first window of {BIN_S:g} s in which its mean over the "
    f"replicates is within {TOLERANCE:g} times that of the same replicates without the fault, if it is so in the next "
    "window, too. After what ends the time counts from its end, after a death from the death. The interval is by "
    "bootstrap over the replicates.",
)


def limits_page(found: Findings, *, blank: bool = False) -> Report:
    """The page of all experiments that were done; `blank` leaves its drawings empty, for who wants the words."""
    sections = [
        Section("The answer", _answer(found)),
        Section("At the hardest level of each limit", _overview(found)),
    ]
    sections += [Section(one.title, _experiment(found, one, blank=blank)) for one in found.experiments]
    sections.append(Section("How it was found", [Notes(METHOD), *_provenance(found)]))
    lead = (
        "The paper leaves open how its coordination modes fare when communication is limited. Here the network is "
        "limited, one way at a time, and parts of the swarm are lost. Every sentence and number below is made from the "
        "runs."
    )
    return Report("When communication is limited", lead, sections)


def _answer(found: Findings) -> list[Block]:
    blocks: list[Block] = [*answer(found), *loss_bar_in_words(found)]
    doubts = too_few(found)
    return [*blocks, Notes(doubts, is_warning=True)] if doubts else blocks


def _overview(found: Findings) -> list[Block]:
    """With the limit against without it, a row per experiment."""
    blocks: list[Block] = []
    for measure in (WAITING, MESSAGES):
        rows: list[list[Cell]] = []
        for experiment in found.experiments:
            cells = [row_of(found, experiment, LIMIT, measure, experiment.hardest, mode, mode) for mode in MODES]
            texts = [f"{size(row, PER[measure])}, {tested(row)}" for row in cells]
            rows.append([experiment.title, experiment.hardest.words, *texts])
        columns = [Column("Limit"), Column("level"), *(Column(mode, is_numeric=True) for mode in MODES)]
        blocks.append(Table(columns, rows, f"{SHOWN[measure]}: with the limit against the same swarm without it"))
    return blocks


def _experiment(found: Findings, experiment: Experiment, *, blank: bool) -> list[Block]:
    lines = [effect_of(found, experiment, mode) for mode in MODES]
    lines.append(paying_in_words(found, experiment))
    lines += [harm_in_words(found, experiment, measure) for measure in (WAITING, MESSAGES)]
    if experiment.fault is not None:
        lines += recovery_in_words(found, experiment)
    blocks: list[Block] = [experiment.what, Notes(lines), _estimates(found, experiment)]
    if experiment.fault is not None:
        blocks.append(_recovery(found, experiment))
    blocks += pictures_of(experiment, found, blank=blank)
    return [*blocks, Command(f"{command(experiment)}\ndeltaswarm sweep {experiment.name}")]


def _estimates(found: Findings, experiment: Experiment) -> Table:
    """Medians with intervals, a row per level and mode."""
    mine = found.estimates[found.estimates["experiment"] == experiment.name]
    known: Mapping[tuple[str, str, str], pd.Series] = {
        (str(row["level"]), str(row["mode"]), str(row["measure"])): row for _, row in mine.iterrows()
    }
    killed = found.runs[found.runs["experiment"] == experiment.name].groupby(["level", "mode"])["killed"].median()
    has_killed = bool((killed > 0).any())
    rows: list[list[Cell]] = []
    for level in experiment.levels:
        for mode in MODES:
            own = [known[level.label, mode, measure] for measure in MEASURES]
            texts = [words.with_interval(row["value"], row["low"], row["high"]) for row in own]
            deaths: list[Cell] = [float(killed[level.label, mode])] if has_killed else []
            rows.append([level.words, mode, int(own[0]["n"]), *texts, *deaths])
    titles = [Column(SHOWN[measure], UNITS[measure], is_numeric=True) for measure in MEASURES]
    columns = [Column("Level"), Column("Mode"), Column("n"), *titles]
    if has_killed:
        columns.append(Column("Agents killed", decimals=1))
    return Table(columns, rows, "Medians over the replicates with 95 % intervals")


def _recovery(found: Findings, experiment: Experiment) -> Table:
    """How long until each measure was back, a row per level, reference and mode."""
    mine = found.recovery[found.recovery["experiment"] == experiment.name]
    rows: list[list[Cell]] = []
    for (level, reference, mode), group in mine.groupby(["level", "reference", "mode"], sort=False):
        by_measure = {str(row["measure"]): row for _, row in group.iterrows()}
        texts = [_back(by_measure[measure]) for measure in MEASURES]
        rows.append([experiment.level(str(level)).words, experiment.level(str(reference)).words, str(mode), *texts])
    columns = [Column("After"), Column("held against"), Column("Mode")]
    columns += [Column(SHOWN[measure], is_numeric=True) for measure in MEASURES]
    return Table(columns, rows, "Time until a swarm is back, with its 95 % interval")


def _back(row: "pd.Series") -> str:
    low, high = duration(float(row["low_s"])), duration(float(row["high_s"]))
    between = "" if words.MISSING in (low, high) else f" [{low}, {high}]"
    return f"{duration(float(row['back_s']))}{between}"


def _provenance(found: Findings) -> list[Block]:
    columns = {
        "experiment": Column("Experiment"),
        "runs": Column("runs"),
        "repeats": Column("replicates"),
        "duration_s": Column("of", "s", 0),
        "by_processes": Column("also by real processes"),
        "equal_digests": Column("with an equal digest"),
        "digest": Column("digest"),
        "begun": Column("begun"),
        "wall_min": Column("wall time of all sessions", "min", 1),
        "version": Column("deltaswarm"),
        "code": Column("code"),
    }
    text = found.sweeps.astype({"digest": str, "begun": str, "version": str, "code": str})
    names = " ".join(experiment.name for experiment in found.experiments)
    return [Table.of(text, columns, "Where the numbers come from"), Command(f"deltaswarm limits {names}")]
