"""Random generators: one for each use, so that one use does not change the draws of another."""

import numpy as np

from deltaswarm_wire.seeds import derived_key


def generator(seed: int, *stream: int) -> np.random.Generator:
    """Make the generator of one stream of a run, which an agent cannot derive from its own seed."""
    return np.random.default_rng([int.from_bytes(derived_key(seed, "world"), "little"), *stream])
