"""Tell how far measurements can be trusted: stolen CPU time, a floor's spread, and ratios only on a steady floor."""

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path

STAT = Path("/proc/stat")

STEAL = 7
"""Position of the stolen time among a CPU's counters; what follows is already counted in the first two."""

MAX_SPREAD = 0.2
"""A floor that varies more over the rounds says nothing about what stands on it."""


def cpu_ticks(file: Path = STAT) -> tuple[int, int]:
    """Return the stolen and the whole time of all CPUs since the start [ticks]."""
    counters = [int(text) for text in file.read_text(encoding="ascii").splitlines()[0].split()[1:]]
    return counters[STEAL], sum(counters[: STEAL + 1])


def stolen_share(before: tuple[int, int], after: tuple[int, int]) -> float:
    """Return the share of CPU time between two `cpu_ticks` that the host gave to others."""
    stolen, whole = (end - start for start, end in zip(before, after, strict=True))
    return stolen / whole if whole else 0.0


def spread(values: Sequence[float]) -> float:
    """Return (largest - smallest) / median."""
    return (max(values) - min(values)) / statistics.median(values)


def shares(
    values: Sequence[float], floors: Mapping[str, Sequence[float]]
) -> tuple[dict[str, float | None], str | None]:
    """Return, by floor, the median of each round's value as a share of the floor's, and why shares are missing.

    A share is None if its floor spreads by more than `MAX_SPREAD`.
    """
    unsteady = {name: spread(rounds) for name, rounds in floors.items() if spread(rounds) > MAX_SPREAD}
    medians = {
        name: None if name in unsteady else statistics.median(map(float.__truediv__, map(float, values), rounds))
        for name, rounds in floors.items()
    }
    found = ", ".join(f"{name} {share:.0%}" for name, share in unsteady.items())
    why = f"a floor must spread by at most {MAX_SPREAD:.0%} over the rounds to give a ratio (got {found})"
    return medians, why if unsteady else None
