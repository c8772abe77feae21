"""Preview what a study would run and what its replicates could show, before hours are spent on it."""

from collections.abc import Iterator

from deltaswarm_orchestrator.stats import pairs_needed, smallest_p
from deltaswarm_orchestrator.studies.evidence import cells
from deltaswarm_orchestrator.studies.study import Study


def plan(study: Study) -> str:
    """Describe the runs and each family of tests, a line each."""
    lines = [study.sweep.size]
    for name, family in families(study):
        least = min(1.0, smallest_p(study.repeats) * family)
        lines.append(f"  {name}: {family} tests in a family, smallest corrected p {least:.2g}")
        if study.repeats < pairs_needed(family):
            lines[-1] += f": can show nothing, {pairs_needed(family)} replicates are needed"
    return "\n".join(lines)


def families(study: Study) -> Iterator[tuple[str, int]]:
    """Yield every family of tests that are corrected together, with its size."""
    for contrast in study.file.contrast:
        levels = len(contrast.pairs) or len(study.factors[contrast.factor]) - 1
        others = cells(study, [contrast.factor, *([contrast.across] if contrast.across else [])])
        family = levels * len(others) * (len(contrast.across_pairs) or 1)
        yield from ((f"contrast {contrast.id!r}, {metric}", family) for metric in study.metrics_of(contrast))
    tested = [claim.source for claim in study.file.claim if claim.kind != "value"]
    yield from ((f"claims of {source!r}", tested.count(source)) for source in dict.fromkeys(tested))
