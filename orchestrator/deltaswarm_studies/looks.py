"""Choose how each level, variant and path is drawn, so that a control looks the same in all figures of a study.

The control is that of the scenario. A name is only a name: nothing is read out of it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies import style
from deltaswarm_studies.study import Study
from deltaswarm_studies.style import Look
from deltaswarm_wire import checked

Control = tuple[str, str]
"""A run's controller with all options, and what its planner knows beyond what agents sense, as one hashable value."""


def of_levels(study: Study, factor: str) -> dict[str, Look]:
    """Return the look of each level of a factor: that of its control if it has one of its own."""
    variants = {
        level: [name for name, levels in study.levels.items() if levels[factor] == level]
        for level in study.factors[factor]
    }
    return of_groups(study, variants)


def of_groups(study: Study, groups: Mapping[str, Sequence[str]], *, are_paths: bool = False) -> dict[str, Look]:
    """Return a look for each group of variants, such as the variants with one level; no two are alike.

    A group of one control has the look of that control, unless another group has it already. A path through several
    controls of one mode has the look of the mode.
    """
    known = _by_control(study)
    scenarios = {variant.label: variant.scenario for variant in study.sweep.variants}
    chosen: dict[str, Look] = {}
    for name, variants in groups.items():
        own = {known[_control(scenarios[variant])] for variant in variants}
        modes = {scenarios[variant].control.mode for variant in variants}
        look = own.pop() if len(own) == 1 else style.MODES.get(modes.pop()) if are_paths and len(modes) == 1 else None
        if look and look not in chosen.values():
            chosen[name] = look
    free = (look for look in style.others() if look not in chosen.values())
    return {name: chosen[name] if name in chosen else next(free) for name in groups}


def _by_control(study: Study) -> dict[Control, Look]:
    """Give each control of a study a look: the first of a mode (and of a delta) has the mode's, others follow."""
    looks: dict[Control, Look] = {}
    others = style.others()
    for variant in study.sweep.variants:
        scenario, control = variant.scenario, _control(variant.scenario)
        if control in looks:
            continue
        own = _of_mode(scenario.control.mode, scenario.control.options) if scenario.run.bound == "none" else None
        looks[control] = own if own and own not in looks.values() else next(others)
    return looks


def _of_mode(mode: str, options: Mapping[str, Any]) -> Look | None:
    return style.hybrid(int(options["delta"])) if mode == "hybrid" else style.MODES.get(mode)


def _control(scenario: Scenario) -> Control:
    return str(sorted(checked.plain(scenario.control).items())), scenario.run.bound
