"""Reseed all random generators of a run, before every step.

In a replicate each generator is seeded before each step, from the replicate's seed, the generator's place in the state,
and the step. So two runs from one state draw alike in a step, whatever they drew in the steps before: what a radio
model draws for more frames does not shift its draws for the next step.
"""

import io
import pickle
import random
from typing import Any

import numpy as np

from deltaswarm_wire.seeds import derived_key


class _Pickler(pickle.Pickler):
    """Leaves generators out, each by its place."""

    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream)
        self.found: dict[int, Any] = {}

    def persistent_id(self, found: Any) -> int | None:
        if not isinstance(found, np.random.Generator | random.Random):
            return None
        self.found.setdefault(id(found), found)
        return list(self.found).index(id(found))


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, generators: list[Any]) -> None:
        super().__init__(stream)
        self._generators = generators

    def persistent_load(self, place: Any) -> Any:
        return self._generators[place]


class Randomness:
    """The generators in the state of a run, drawing from another seed."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.generators: list[Any] = []

    def load(self, state: bytes) -> Any:
        """Load a pickled state, and find its generators, which draw as before until `begin_step`."""
        pickler = _Pickler(stream := io.BytesIO())
        pickler.dump(pickle.loads(state))
        self.generators = list(pickler.found.values())
        return _Unpickler(io.BytesIO(stream.getvalue()), self.generators).load()

    def find(self, state: Any) -> None:
        """Find the generators of a state that is under way."""
        pickler = _Pickler(io.BytesIO())
        pickler.dump(state)
        self.generators = list(pickler.found.values())

    def text(self, place: int, step: int) -> str:
        """Return what seeds Python's own generator in a place, for a step."""
        return f"deltaswarm/{(self.seed, place, step)}"

    def begin_step(self, step: int, places: slice = slice(None)) -> None:
        """Seed the generators in some places for a step."""
        for place, found in list(enumerate(self.generators))[places]:
            if isinstance(found, np.random.Generator):
                kind: Any = type(found.bit_generator)
                found.bit_generator.state = kind(np.random.SeedSequence((self.seed, place, step))).state
            else:
                found.seed(self.text(place, step))


def replicate_seed(seed: int, step: int, number: int) -> int:
    """Return the seed of a replicate of what comes after a step: 63 bits, from which nothing else is drawn."""
    return int.from_bytes(derived_key(seed, f"branch at {step}, replicate {number}")[:8], "little") >> 1
