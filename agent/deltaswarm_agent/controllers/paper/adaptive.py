"""A swarm that chooses delta while it runs (the paper's open question), with patience and return to finds.

Hybrid control with other defaults. Each part is a key of `PaperSettings`, so that each can be switched off, or on in
another mode: `delta.py`, `patience.py` and `returning.py` have the rules.
"""

from dataclasses import dataclass
from typing import ClassVar

from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.settings import ALL, BUSY, PaperSettings
from deltaswarm_wire.checked import with_default


@dataclass(frozen=True)
class AdaptiveSettings(PaperSettings):
    delta_rule: str = with_default(PaperSettings, "delta_rule", BUSY)
    patience_finds: float = with_default(PaperSettings, "patience_finds", 0.3)
    return_to_finds: bool = with_default(PaperSettings, "return_to_finds", True)
    member_observes: str = with_default(PaperSettings, "member_observes", ALL)


class AdaptiveController(PaperController):
    Settings: ClassVar[type[PaperSettings]] = AdaptiveSettings
