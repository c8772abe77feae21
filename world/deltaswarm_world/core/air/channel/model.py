"""Build the radio models of a scenario, shipped or from outside, in the order in which they apply to a frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self
from zlib import crc32

import numpy as np

from deltaswarm_scenario.radio import REASON
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import DROP_REASONS
from deltaswarm_wire.foreign import Foreign, called, is_foreign, name_of
from deltaswarm_wire.plugin_errors import PluginError, defined_at
from deltaswarm_wire.plugins import RADIO_MODELS, find, own_settings
from deltaswarm_world.core.air.channel.links import Diagnosis, Links
from deltaswarm_world.core.air.channel.reach import Reach
from deltaswarm_world.core.arrays import Mask, checked_mask, checked_truth, generator

FOREIGN_STREAM = 30
"""Stream of the generators of models from outside, each with a number from its class."""


@dataclass(frozen=True)
class Context:
    """The inputs of a new model."""

    scenario: Scenario
    reach: Reach
    """Reach by distance or power, before any model cuts a link."""
    settings: Any = None
    """The model's own settings, if its class has `Settings`."""
    name: str = ""
    """The model's class, as `module:Class`."""

    @property
    def ends(self) -> int:
        """Number of agents; their ids are the ends of links."""
        return self.scenario.agents.count

    @property
    def step_s(self) -> float:
        """Length of a step [s]."""
        return self.scenario.run.step_s

    def rng(self, stream: int | None = None) -> np.random.Generator:
        """Make a model's own generator, so that models do not change each other's draws.

        A shipped model has its own unique `stream`; without one, the generator is that of the model's class.
        """
        if stream is None:
            return generator(self.scenario.seed, FOREIGN_STREAM, crc32(self.name.encode()))
        return generator(self.scenario.seed, stream)


class Model(Protocol):
    """One model, which cuts links. Its class may have `Settings`, a frozen dataclass of its options."""

    reason: str
    """The reason under which its cuts are counted: lower-case letters, digits and underscores."""
    meaning: str
    """Why such a frame does not reach a receiver, for the table of reasons."""
    holds_for_step: bool
    """Whether it cuts links for whole steps, without draws and state; the relay uses it, too."""

    @classmethod
    def of(cls, context: Context) -> Self | None:
        """Build the scenario's model; None if it is off."""

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        """Return the links cut in this step (None: none), called once per step. Only this method may draw."""

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        """Explain a single link (the only row), without a draw and without a change of state."""


def _cuts(_: None, value: Any, links: Links, time_s: float) -> Mask | None:
    # The air changes the mask.
    return None if value is None else checked_mask(value, len(links), "the links").copy()


def _explanation(_: None, value: Any, links: Links, time_s: float) -> Diagnosis:
    if not isinstance(value, Diagnosis) or not isinstance(value.says, str) or not isinstance(value.numbers, dict):
        raise ValueError(f"must be a Diagnosis of a reason, whether it cuts, a text and a dict (got {value!r:.80})")
    return value._replace(cuts=bool(value.cuts))


def _reason(_: None, value: Any) -> str:
    if not isinstance(value, str) or not REASON.fullmatch(value):
        raise ValueError(f"must be lower-case letters, digits and underscores (got {value!r:.80})")
    return value


class ForeignModel(Foreign):
    CHECKS: ClassVar = {"cuts": _cuts, "explain": _explanation, "reason": _reason, "holds_for_step": checked_truth}


def models_of(scenario: Scenario, reach: Reach) -> list[Model]:
    """Build the models that are on, in order; the first one that cuts a frame gives the reason.

    Models from outside come before the last shipped one, contention, which counts what the others let through.
    """
    *shipped, last = RADIO_MODELS.shipped
    named = scenario.radio.models
    models = []
    for name in [*shipped, *(name for name in named if name not in RADIO_MODELS.shipped), last]:
        path = f'radio.models."{name}"'
        cls: type[Model] = find(RADIO_MODELS, name, path)
        if hasattr(cls, "Settings") and name not in named:
            continue
        settings = own_settings(RADIO_MODELS, name, named[name], path) if name in named else None
        model = called(f"{name_of(cls)}.of", cls.of, Context(scenario, reach, settings, name_of(cls)))
        if model is not None and is_foreign(cls):
            if not all(hasattr(model, member) for member in RADIO_MODELS.needed):
                must = f"{name_of(cls)}.of must return a radio model or None (got {model!r:.80})"
                raise PluginError(f"{must} ({defined_at(cls.of)})")
            model = ForeignModel(model)
            _ = model.cuts, model.explain, model.reason, model.holds_for_step  # before hours are spent
        if model is not None:
            models.append(model)
    return models


def reasons_of(models: Sequence[Model]) -> tuple[str, ...]:
    """Return every reason for which the air may drop a frame: the shipped ones, then those of models from outside."""
    return tuple(dict.fromkeys((*DROP_REASONS, *(model.reason for model in models))))
