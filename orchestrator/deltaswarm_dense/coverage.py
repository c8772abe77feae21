"""Which scenarios the dense engine covers, key by key; the others are run by the Python engine."""

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from deltaswarm_agent.controllers.paper.commands import SET_DELTA, SET_PRICE, SET_STRUCTURE
from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_agent.controllers.paper.timers import timers
from deltaswarm_dense.layout import MAX_ORDERS
from deltaswarm_scenario.operator_links import CommandSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import plain
from deltaswarm_wire.commands import ALL
from deltaswarm_wire.messages import MAX_POSES
from deltaswarm_wire.plugins import INBOX_POLICIES

MODES = ("decentralised", "hierarchical", "hybrid", "adaptive")

FAULTS = ("kill", "restart", "freeze", "actuator-slow", "actuator-stuck", "radio-dead", "sensor-blind")
"""Kinds that change neither what is where nor how it is sensed."""

ANY = frozenset(
    [
        "schema",
        "name",
        "seed",
        "record",
        "run.duration_s",
        "run.step_s",
        "run.real_time_factor",
        "run.ask_every_step",
        "run.step_timeout_s",
        "run.start_timeout_s",
        "run.accept_lost",
        "arena.width_m",
        "arena.height_m",
        "events.rate_hz",
        "events.rates_hz",
        "events.rates_s",
        "events.work_agent_s",
        "agents.count",
        "agents.speed_mps",
        "agents.sensing_range_m",
        "downlink.base_m",
        "downlink.range_m",
        "downlink.loss",
        "downlink.repeat_s",
        "downlink.outages",
        "command",
        "fault",
        "operator.threshold_hz",
        "operator.more_thresholds_hz",
        "metrics.horizon_s",
        "control.delta",
        "control.rho",
        "control.recruitment",
        "control.dissolution",
        "control.d_min_m",
        "control.gamma_max",
        "control.recruitment_interval_s",
        "control.recruitment_places",
        "control.idle_root",
        "control.root_succession",
        "control.leg_max_s",
        "control.leg_exponent",
        "control.patience_finds",
        "control.return_to_finds",
        "control.find_memory_s",
        "control.delta_rule",
        "control.policy",
        "control.message_price",
        "control.report_finds",
        "control.member_observes",
        "control.report_every_s",
        "control.report_members",
    ]
)
"""Keys that may have any value."""

ANY_BELOW = (
    *("events.density.", "operator.probes.", "operator.page.", "operator.inbox.", "operator.budget."),
    *("operator.person.", "operator.autonomy.", "radio.", "uplink."),
)
"""Tables whose keys may: arrivals and the console are the Python engine's own."""

DEFAULT = frozenset(
    [
        "run.clock",
        "run.bound",
        "arena.obstacles",
        "radio.models",
    ]
)
"""Keys that must have their defaults."""

DEFAULT_BELOW = ("world.", "radio.models.", "downlink.", "operator.task.")
"""Tables whose keys must, unless they are in `ANY`."""


def not_covered(scenario: Scenario) -> list[str]:
    """Return why a scenario is not covered: its keys with their values; nothing if it is covered."""
    mode = scenario.control.mode
    if mode not in MODES:
        return [f"control.mode = {mode!r}"]
    if (policy := scenario.operator.inbox.policy) not in INBOX_POLICIES.shipped:  # whose errors that engine reports
        return [f"operator.inbox.policy = {policy!r}"]
    if orders := [command.name for command in scenario.command if not _is_covered(command)]:
        return [f"command {orders[0]!r}"]
    if faults := [fault.kind for fault in scenario.fault if fault.kind not in FAULTS]:
        return [f"fault.kind = {faults[0]!r}"]
    trail = timers(scenario.run.step_s, scenario.radio.latency_s + scenario.radio.jitter_s).trail
    if trail > MAX_POSES and any(fault.kind == "freeze" for fault in scenario.fault):  # poses are missing afterwards
        return [f"fault.kind = 'freeze' with steps of {scenario.run.step_s:g} s"]
    if len(scenario.command) > MAX_ORDERS // 2:
        return [f"{len(scenario.command)} commands"]
    given = dict(_flat(plain(scenario) | {"control": scenario.control.options}))
    return [
        f"{key} = {value!r:.40}"
        for key, value in given.items()
        if rule(key) is not ANY and value != _defaults().get(key)
    ]


@cache
def _defaults() -> dict[str, Any]:
    return dict(_flat(plain(Scenario()) | {"control": plain(PaperSettings())}))


def _is_covered(command: CommandSettings) -> bool:
    return command.name in (SET_DELTA, SET_PRICE, SET_STRUCTURE) and command.target == ALL


def rule(key: str) -> frozenset[str]:
    """Return `ANY` or `DEFAULT` for a key of the scenario, with the controller's own below `control`.

    Raises:
        KeyError: nothing is said about the key.
    """
    if key in DEFAULT or key.startswith(DEFAULT_BELOW):
        if key not in ANY:
            return DEFAULT
    if key in ANY or key.startswith(ANY_BELOW):
        return ANY
    raise KeyError(key)


def _flat(table: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value
