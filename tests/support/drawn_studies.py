"""A made-up sensitivity study: it is known at which points its claim holds, and why."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.study import Study
from tests.support.studying import made

DRAWN = """
schema = 1
name = "made-up"
base = "smoke"

[scenario]
run.duration_s = 60.0
metrics.horizon_s = 20.0

[sweep]
prove = 0
series_every_s = 0.0

[[sweep.paired]]
label = ["trees", "none"]
control.mode = ["hybrid", "decentralised"]

[sensitivity]
points = 60

[[sensitivity.range]]
name = "events.rate_hz"
title = "Event rate"
unit = "1/s"
low = 0.05
high = 0.5
scale = "log"

[[sensitivity.range]]
name = "radio.range_m"
title = "Radio range"
unit = "m"
low = 7.0
high = 15.0

[[sensitivity.range]]
name = "control.recruitment"
title = "Recruitment"
choices = { on = true, off = false }

[[sensitivity.range]]
name = "control.member_observes"
title = "A member works on"
choices = { "the nearest" = "nearest", "all" = "all" }
"""
CLAIMED = """
[study]
title = "Made up"
factors = { control = "control" }
metrics = ["messages"]

[[claim]]
id = "quiet"
text = "Trees report less"
metric = "messages"
less = "trees"
more = "none"
"""

Ratio = Callable[[dict[str, Any], int], float]
"""Of a point's values and its number: how many times as much is sent without trees as with them."""


def rate(values: dict[str, Any]) -> float:
    """Where a point lies in the range of rates, from 0 to 1."""
    return math.log(values["events.rate_hz"] / 0.05) / math.log(10)


def noise(number: int, spread: float = 0.3) -> float:
    """A factor that has nothing to do with the point."""
    return math.exp(spread * np.random.default_rng([5, number]).normal())


def table(study: Study, ratio: Ratio) -> pd.DataFrame:
    """The table of the study's sweep, in which the ratio of messages at each point is given."""
    return pd.DataFrame(
        [
            {
                "variant": job.variant.label,
                **job.variant.keys,
                "replicate": job.replicate,
                "seed": job.scenario.seed,
                "operator_messages_per_s.mean": 4.0
                * (ratio(dict(job.variant.keys), job.replicate) if job.variant.label == "none" else 1.0),
            }
            for job in study.sweep.jobs()
        ]
    )


def found(ratio: Ratio, own: str = CLAIMED, sweep: str = DRAWN) -> tuple[Study, Evidence]:
    """What a study finds in a table that is made up."""
    study = made(own, sweep)
    return study, Evidence.of_sweep(study, table(study, ratio), pd.DataFrame())
