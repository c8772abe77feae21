"""The world's row of `series.csv`, from the counts of one step."""

from collections.abc import Mapping
from typing import Any

from deltaswarm_scenario.truth import DROP_REASONS, UPLINK_REASONS, StepRecord

_NOTHING_DROPPED = {f"dropped_{reason}": 0 for reason in DROP_REASONS} | {
    f"reports_dropped_{reason}": 0 for reason in UPLINK_REASONS
}


def record(*, frames_dropped: Mapping[str, int], reports_dropped: Mapping[str, int], **counts: Any) -> StepRecord:
    """The row: frames and reports that were dropped by reason, all other fields by name."""
    row = {**_NOTHING_DROPPED, **counts}
    for reason, count in frames_dropped.items():
        row[f"dropped_{reason}"] = count
    for reason, count in reports_dropped.items():
        row[f"reports_dropped_{reason}"] = count
    return StepRecord._make([row[name] for name in StepRecord._fields])
