"""Load studies from TOML files or built-in ones, make one for a bare sweep, and check each as a whole."""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from deltaswarm_orchestrator.results.metrics import METRICS
from deltaswarm_orchestrator.sweeps.load import STUDY_TABLES, load_sweep, read_file
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_studies import FOLDERS, files
from deltaswarm_studies.checks import problems_of
from deltaswarm_studies.kinds import MOST_LOOKS
from deltaswarm_studies.metrics import BUILT_IN, COMPLETION, WAITING, WAITING_ALL, MetricSettings, controllers_own
from deltaswarm_studies.settings import EXPLORATORY, ContrastSettings, FigureSettings, StudyFile, StudySettings
from deltaswarm_studies.study import Study, default_factors, numbers_of
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError

if TYPE_CHECKING:
    import pandas as pd

COLLECTIONS = {folder: list(files(folder)) for folder in FOLDERS} | {"all": list(files())}
"""The built-in studies by the name of their folder, and all of them. Those of a collection are done one by one."""

MAIN = (WAITING, WAITING_ALL, COMPLETION, "messages", "frames_sent", "agents_in_trees")
"""Metrics of a sweep without a study file."""
DRAWN = (WAITING, COMPLETION, "messages")
OVER_TIME = "agents_in_trees"


OF_A_STUDY = ("sweep", "provenance.csv", "protocol.json", "seal.json", "manifest.json")
"""What tells the folder of a study or sweep, into which a page may be written, from any other."""


def load_study(
    name: str, overrides: Sequence[str] = (), settings: Mapping[str, int | float | None] | None = None
) -> Study:
    """Load the study of a file or a built-in name; `overrides` set scenario keys, `settings` keys of `[sweep]`.

    Raises:
        SettingsError: Every mistake in the sweep and in the study's own tables; if there are none, names of factors,
            levels, variants, metrics or results that do not exist, and times that do not fit.
    """
    table, _ = read_file(name, "study", COLLECTIONS)
    own, unclear = expanded({key: value for key, value in table.items() if key in STUDY_TABLES})
    file, problems = checked.check(StudyFile, own)
    problems = unclear or problems
    try:
        sweep = load_sweep(name, overrides, settings)
    except SettingsError as error:
        raise SettingsError([*error.problems, *problems]) from None
    if unclear:
        raise SettingsError(unclear)
    if file is None:
        raise SettingsError(problems)
    return replace(make_study(sweep.name, file, sweep), is_built_in=name in COLLECTIONS["all"])


def expanded(tables: Mapping[str, Any]) -> tuple[dict[str, Any], list[Problem]]:
    """Repeat each row that has a table `each` for every combination of its words, which replace their names in braces.

    `each = { cell = ["few", "many"] }` makes two rows, with "few" and "many" for "{cell}" wherever it stands.
    """
    rows: dict[str, Any] = {}
    problems = []
    for name, given in tables.items():
        if not isinstance(given, list) or not all(isinstance(row, dict) for row in given):
            rows[name] = given
            continue
        rows[name] = []
        for place, row in enumerate(given):
            each = row.get("each", {})
            if not isinstance(each, dict) or not all(_are_words(words) for words in each.values()):
                allowed = 'must be lists of words by name, such as { cell = ["few events", "many events"] }'
                problems.append(Problem(f"{name}[{place}].each", repr(each), allowed))
                continue
            plain = {key: value for key, value in row.items() if key != "each"}
            rows[name] += [
                _put_in(plain, dict(zip(each, words, strict=True))) for words in itertools.product(*each.values())
            ]
    return rows, problems


def _are_words(words: Any) -> bool:
    return isinstance(words, list) and bool(words) and all(isinstance(word, str) for word in words)


def _put_in(value: Any, words: Mapping[str, str]) -> Any:
    if isinstance(value, str):
        for name, word in words.items():
            value = value.replace(f"{{{name}}}", word)
        return value
    if isinstance(value, list):
        return [_put_in(item, words) for item in value]
    if isinstance(value, dict):
        return {_put_in(key, words): _put_in(item, words) for key, item in value.items()}
    return value


def make_study(name: str, file: StudyFile, sweep: Sweep) -> Study:
    """Put a study together.

    Raises:
        SettingsError: Names of factors, levels, variants, metrics or results that do not exist; times that do not fit.
    """
    names = list(file.study.factors) or default_factors(sweep)
    if len(names) != len(sweep.factors):
        count = f"{len(names)} names ({', '.join(names)})"
        raise SettingsError(
            [Problem("study.factors", count, f"must name the {len(sweep.factors)} things that this sweep varies")]
        )
    of_runs = {**BUILT_IN, **controllers_own(sweep)}
    built_in = {name: metric.within(name, file.study.from_s, file.study.until_s) for name, metric in of_runs.items()}
    factors = dict(zip(names, sweep.factors, strict=True))
    metrics = built_in | {settings.name: settings.metric() for settings in file.metric}
    study = Study(name, file, sweep, factors, metrics)
    if problems := list(dict.fromkeys(problems_of(study))):
        raise SettingsError(problems)
    return study


def bare_study(
    sweep: Sweep, table: "pd.DataFrame", *, has_series: bool, reference: str | None = None, more: Sequence[str] = ()
) -> Study:
    """Make a study that compares every factor's levels with the first, or with `reference`.

    `more` are columns of the table to study besides the main metrics, of which those are left out that cannot be shown.

    Raises:
        ValueError: If no factor has the reference among its levels, or the table lacks a column.
    """
    titles = default_factors(sweep)
    factors = dict(zip(titles, sweep.factors, strict=True))
    references = {
        name: reference if reference is not None and reference in levels else levels[0]
        for name, levels in factors.items()
    }
    if reference is not None and reference not in references.values():
        known = ", ".join(repr(level) for levels in factors.values() for level in levels)
        raise ValueError(f"--reference must be a level of what was swept (got {reference!r}; there are {known})")
    for column in more:
        if column not in table:
            raise ValueError(f"--metric must be a column of table.csv (got {column!r})")
    recorded = [name for name in MAIN if BUILT_IN[name].column in table and table[BUILT_IN[name].column].notna().any()]

    def file_of(
        main: Sequence[str], compared: Mapping[str, Sequence[str]], figures: Sequence[FigureSettings]
    ) -> StudyFile:
        return StudyFile(
            StudySettings(
                title=f"Sweep {sweep.name}",
                kind=EXPLORATORY,
                question="How do the levels of what was swept differ?",
                factors=titles,
                metrics=(*main, *more),
                window_s=sweep.file.sweep.series_every_s or 300.0,
            ),
            tuple(_metric_of(column) for column in more),
            tuple(
                ContrastSettings(
                    id=name,
                    text=f"The levels of {titles[name]} against {references[name]}",
                    factor=name,
                    reference=references[name],
                    metrics=(*metrics, *more),
                )
                for name, metrics in compared.items()
                if metrics or more
            ),
            figure=tuple(figures),
        )

    left_out: dict[str, list[str]] = {}

    def is_possible(part: str, main: Sequence[str], by: str = "", figures: Sequence[FigureSettings] = ()) -> bool:
        try:
            make_study(sweep.name, file_of(main, {by: main} if by else {}, figures), sweep)
        except SettingsError as error:
            reason = re.sub(r" \(contrast\[0\]: '\w+'\)|^contrast\[0\]\.metrics ", "", str(error.problems[0]))
            left_out.setdefault(reason, []).append(part)
            return False
        return True

    varying = [name for name, levels in factors.items() if len(levels) > 1]
    shown = [name for name in recorded if is_possible(BUILT_IN[name].title, [name])]
    compared = {
        factor: [
            name
            for name in shown
            if name != WAITING_ALL
            and is_possible(f"{BUILT_IN[name].title}, compared by {titles[factor]}", [name], factor)
        ]
        for factor in varying
    }
    drawn = _figures(sweep, titles, [name for name in DRAWN if name in shown], has_series)
    figures = [figure for figure in drawn if is_possible(f"the figure {figure.name!r}", shown, figures=[figure])]
    lines = [f"Left out: {'; '.join(parts)}, since {reason}." for reason, parts in left_out.items()]
    study = make_study(sweep.name, file_of(shown, compared, figures), sweep)
    return replace(study, left_out=tuple(lines))


def _metric_of(column: str) -> MetricSettings:
    known = next((metric for metric in METRICS if metric.key == column), None)
    title, unit = (known.title or known.label or column, known.unit) if known else (column, "")
    return MetricSettings(name=column, title=title, unit=unit, column=column)


def _figures(sweep: Sweep, titles: Mapping[str, str], metrics: Sequence[str], has_series: bool) -> list[FigureSettings]:
    """Choose boxes, or medians along a numeric factor; the next factor is shown by colour, a third by panel.

    Over time, all but the first two factors are held at their first levels.
    """
    factors = dict(zip(titles, sweep.factors, strict=True))
    names = sorted(factors, key=lambda name: -len(factors[name]))
    numeric = [name for name in names if len(factors[name]) > 2 and numbers_of(sweep, list(factors).index(name))]
    x = numeric[0] if numeric else names[0]
    others = [name for name in names if name != x]
    hue, facet, *_ = [*(name for name in others if len(factors[name]) <= MOST_LOOKS), "", ""]
    kind = "levels" if numeric else "boxes"
    drawn = [
        FigureSettings(
            name=metric, kind=kind, metric=metric, x=x, hue=hue, facet=facet, caption=f"{BUILT_IN[metric].title}."
        )
        for metric in metrics
    ]
    if has_series and len(factors[x]) <= MOST_LOOKS:
        held = {name: factors[name][0] for name in others if name != hue}
        rows = zip(sweep.variants, itertools.product(*factors.values()), strict=True)
        variants = tuple(
            variant.label for variant, levels in rows if held.items() <= dict(zip(factors, levels, strict=True)).items()
        )
        at = "".join(f", {titles[name]}: {level}" for name, level in held.items())
        caption = f"{BUILT_IN[OVER_TIME].title} over time{at}."
        drawn.append(
            FigureSettings(
                name=OVER_TIME, kind="time", metric=OVER_TIME, hue=x, facet=hue, variants=variants, caption=caption
            )
        )
    return drawn
