"""Samples whose statistics can be worked out by hand, for tests of contrasts, claims and plans."""

import itertools
import math

import numpy as np
import pandas as pd

from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import runs_of
from tests.support.studying import Value, table

NONE = pd.DataFrame()
NOISE = (0.31, -0.12, 0.57, 0.08, 0.44, -0.21, 0.39, 0.15, 0.66, 0.02)
"""Logarithms of ten ratios without a tie, of which two are negative."""
ONE = '[[contrast]]\nid = "c"\nfactor = "loss"\npairs = [["loss=0.9", "loss=0.0"]]\nmetrics = ["waiting_all"]\n'
TWO_CLAIMS = '[[claim]]\nid = "{}"\ntext = "t"\nmetric = "waiting_all"\n{}\n'


def runs_with(study: Study, waiting: Value, **others: Value) -> pd.DataFrame:
    return runs_of(study, table(waiting, **others), NONE)


def noisy(level: str, mode: str, replicate: int) -> float:
    """Under loss 0.9, the ratios of `NOISE` to the waiting without loss."""
    return 20.0 + replicate if level != "loss=0.9" else (20.0 + replicate) * math.exp(NOISE[replicate])


def walsh(values: np.ndarray) -> np.ndarray:
    """The means of all pairs of values, each with itself too, in order."""
    return np.sort([(a + b) / 2 for a, b in itertools.combinations_with_replacement(values, 2)])
