"""Load studies from TOML files, or built in: a file is checked as a whole before anything runs."""

from collections.abc import Mapping, Sequence

from deltaswarm_orchestrator.scenarios.load import files_in
from deltaswarm_orchestrator.studies.checks import problems_of
from deltaswarm_orchestrator.studies.metrics import BUILT_IN as METRICS
from deltaswarm_orchestrator.studies.settings import StudyFile
from deltaswarm_orchestrator.studies.study import Study, default_factors
from deltaswarm_orchestrator.sweeps.load import STUDY_FOLDERS, STUDY_TABLES, load_sweep, read_file
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError

COLLECTIONS = {folder.rpartition("/")[2]: list(files_in(folder)) for folder in STUDY_FOLDERS}
"""The built-in studies by the name of their folder, and all of them. Those of a collection are done one by one."""
COLLECTIONS["all"] = [name for names in COLLECTIONS.values() for name in names]


def load_study(
    name: str, overrides: Sequence[str] = (), settings: Mapping[str, int | float | None] | None = None
) -> Study:
    """Load the study of a file or a built-in name; `overrides` set scenario keys, `settings` keys of `[sweep]`.

    Raises:
        SettingsError: Every mistake in the sweep and in the study's own tables; if there are none, names of factors,
            levels, variants, metrics or results that do not exist, and times that do not fit.
    """
    table, _ = read_file(name, "study", COLLECTIONS)
    file, problems = checked.check(StudyFile, {key: value for key, value in table.items() if key in STUDY_TABLES})
    try:
        sweep = load_sweep(name, overrides, settings)
    except SettingsError as error:
        raise SettingsError([*error.problems, *problems]) from None
    if file is None:
        raise SettingsError(problems)
    return make_study(sweep.name, file, sweep)


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
    own = {metric.name: metric.made() for metric in file.metric}
    built_in = {name: metric.within(name, file.study.from_s, file.study.until_s) for name, metric in METRICS.items()}
    factors = dict(zip(names, sweep.factors, strict=True))
    study = Study(name, file, sweep, factors, {**built_in, **own})
    if problems := list(dict.fromkeys(problems_of(study))):
        raise SettingsError(problems)
    return study
