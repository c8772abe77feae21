"""Every extension point of deltaswarm, and how names are resolved to what is shipped or added there.

What comes with deltaswarm enters by the same door: a name is that of something shipped, of an entry point, or
`module:Class`, and its options are checked by its own `Settings`.
"""

import importlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, is_dataclass
from typing import Any, ClassVar, NamedTuple

from deltaswarm_wire import checked, extras
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.plugin_errors import PluginError, blamed, described, is_interrupt, note_plugin

PAPER = "deltaswarm_agent.controllers.paper.controller:PaperController"


@dataclass(frozen=True)
class NoSettings:
    """The settings of what takes no options."""


class ExtensionPoint(NamedTuple):
    """One kind of thing that other packages can add."""

    group: str
    """The group of entry points in which an installed package names what it adds."""
    what: str
    """One such thing, for messages."""
    protocol: str
    """Where its protocol is described, as `module:name`."""
    shipped: Mapping[str, str]
    """`module:Class` by name, of what comes with deltaswarm's core; found without a search through all packages."""
    needed: tuple[str, ...] = ("Settings",)
    """The attributes that the class must have."""

    def names(self) -> dict[str, str]:
        """Return `module:Class` by name: what is shipped, and what installed packages add."""
        from importlib.metadata import entry_points  # costs a board 2 MB; most need no entry point

        return {**self.shipped, **{point.name: point.value for point in entry_points(group=self.group)}}


CONTROLLERS = ExtensionPoint(
    "deltaswarm.controllers",
    "controller",
    "deltaswarm_agent.controller:Controller",
    {
        "decentralised": PAPER,
        "hierarchical": PAPER,
        "hybrid": PAPER,
        "adaptive": "deltaswarm_agent.controllers.paper.adaptive:AdaptiveController",
        "central": "deltaswarm_agent.controllers.central.controller:CentralController",
        "potential": "deltaswarm_agent.controllers.potential:PotentialController",
    },
    ("Settings", "step"),
)
"""What `control.mode` takes. A new controller of the core is a line here."""

BODIES = ExtensionPoint(
    "deltaswarm.bodies",
    "body",
    "deltaswarm_agent.body:Body",
    {},
    ("Settings", "REAL_TIME", "sense", "move", "close"),
)
"""What `body.kind` takes on a board; all bodies come with extension packages."""

RADIO_MODELS = ExtensionPoint(
    "deltaswarm.radio_models",
    "radio model",
    "deltaswarm_world.core.air.channel.model:Model",
    {
        "blackout": "deltaswarm_world.core.air.channel.zones:Blackouts",
        "partition": "deltaswarm_world.core.air.channel.zones:Walls",
        "obstacle": "deltaswarm_world.core.air.channel.zones:RadioObstacles",
        "jam": "deltaswarm_world.core.air.channel.zones:Jammers",
        "asymmetry": "deltaswarm_world.core.air.channel.loss:Asymmetry",
        "loss": "deltaswarm_world.core.air.channel.loss:Loss",
        "burst": "deltaswarm_world.core.air.channel.loss:Bursts",
        "contention": "deltaswarm_world.core.air.channel.loss:Contention",
    },
    ("reason", "meaning", "holds_for_step", "of", "cuts", "explain"),
)
"""What `radio.models` takes. A new model of the core is a line here, by its reason, in order."""

FAULTS = ExtensionPoint(
    "deltaswarm.faults",
    "fault",
    "deltaswarm_world.core.faults.kind:Kind",
    {
        "kill": "deltaswarm_world.core.faults.kinds:Kill",
        "freeze": "deltaswarm_world.core.faults.kinds:Freeze",
        "restart": "deltaswarm_world.core.faults.kinds:Restart",
        "sensor-blind": "deltaswarm_world.core.faults.kinds:Blind",
        "sensor-noisy": "deltaswarm_world.core.faults.kinds:Noisy",
        "actuator-slow": "deltaswarm_world.core.faults.kinds:Slow",
        "actuator-stuck": "deltaswarm_world.core.faults.kinds:Stuck",
        "radio-dead": "deltaswarm_world.core.faults.kinds:RadioDead",
        "lying": "deltaswarm_world.core.faults.kinds:Lying",
    },
    ("Settings", "lasts", "to_process", "begin", "end", "look", "misses", "distort", "drive"),
)
"""What `fault.kind` takes, in the order in which faults act on a body. A new kind of the core is a line here."""

INBOX_POLICIES = ExtensionPoint(
    "deltaswarm.inbox_policies",
    "policy of the inbox",
    "deltaswarm_operator.inbox.policy:Policy",
    {
        "all": "deltaswarm_operator.inbox.all:All",
        "new": "deltaswarm_operator.inbox.all:New",
        "grouped": "deltaswarm_operator.inbox.grouped:Grouped",
        "ranked": "deltaswarm_operator.inbox.all:Ranked",
        "limited": "deltaswarm_operator.inbox.limited:Limited",
        "digest": "deltaswarm_operator.inbox.digest:Digest",
    },
    ("Settings", "ORDER", "HELD", "close_step"),
)
"""What `operator.inbox.policy` takes. A new policy of the core is a line here."""

DYNAMICS = ExtensionPoint(
    "deltaswarm.dynamics",
    "kind of dynamics",
    "deltaswarm_world.core.dynamics:Dynamics",
    {"point": "deltaswarm_world.core.dynamics:Points"},
    ("Settings", "misplaced", "move", "states"),
)
"""What `world.dynamics` takes: how bodies move. Bodies that take up room come with an extension package."""

COMMANDS = ExtensionPoint("deltaswarm.commands", "command", "deltaswarm_cli.main:AddArguments", {}, ())
"""Commands of `deltaswarm`; those of the core are listed in `deltaswarm_cli.main`."""

PARTS = ExtensionPoint(
    "deltaswarm.parts",
    "part",
    "deltaswarm_agent.__main__:main",
    {part: f"deltaswarm_{part}.__main__:main" for part in ("agent", "world", "operator")},
    (),
)
"""Commands that start one part by hand; each is a function that reads the arguments after its name."""

ENGINES = ExtensionPoint(
    "deltaswarm.engines", "engine", "deltaswarm_orchestrator.processes.elsewhere:RunEngine", {}, ()
)
"""What `--engine` takes besides `local`: where the agents of a run, or the runs of a sweep, are."""

IN_PROCESS_ENGINES = ExtensionPoint(
    "deltaswarm.in_process_engines",
    "engine of runs in one process",
    "deltaswarm_orchestrator.run.engine:CoveringEngine",
    {},
    ("NEEDS", "why_not", "__call__"),
)
"""What does runs in one process faster than the Python engine, with the same outcome."""

OBSERVERS = ExtensionPoint(
    "deltaswarm.observers", "observer", "deltaswarm_orchestrator.live.observers:NamedObserver", {}, ()
)
"""What `--live` takes besides `foxglove`: who is shown a run under way."""

SWEEPS = ExtensionPoint(
    "deltaswarm.sweeps",
    "collection of sweep files",
    "deltaswarm_orchestrator.sweeps.load:files",
    {"sweeps": "deltaswarm_orchestrator.sweeps.load:files"},
    (),
)
"""Built-in files that `deltaswarm sweep` takes by their names: by kind, a function that returns the files by name."""

POINTS = (
    CONTROLLERS,
    BODIES,
    RADIO_MODELS,
    FAULTS,
    DYNAMICS,
    INBOX_POLICIES,
    COMMANDS,
    PARTS,
    ENGINES,
    OBSERVERS,
    SWEEPS,
)
"""Every extension point; docs/EXTENDING.md tells how each is used."""


@dataclass(frozen=True)
class RecordedSettings:
    """The options of a plug-in as a run recorded them, all of them: they were checked when the run began."""

    options: dict[str, Any] = checked.rest("the options")


class Recorded:
    """Stands for the class of a plug-in where a run is read and nothing is computed: no foreign code is imported."""

    Settings = RecordedSettings
    Metrics: ClassVar[tuple[Any, ...]] = ()
    """A controller's own numbers, as far as the run recorded them."""
    Commands: ClassVar[tuple[Any, ...]] = ()
    """The orders that a controller accepts, likewise."""


_recorded: ContextVar[type[Recorded] | None] = ContextVar("recorded", default=None)
"""What stands for plug-ins here; None: they are imported."""


@contextmanager
def as_recorded(metrics: tuple[Any, ...] = (), commands: tuple[Any, ...] = ()) -> Iterator[None]:
    """Let `Recorded` stand for each plug-in of a run that is read, with its controller's metrics and commands."""
    token = _recorded.set(type("Recorded", (Recorded,), {"Metrics": metrics, "Commands": commands}))
    try:
        yield
    finally:
        _recorded.reset(token)


def is_reading() -> bool:
    """Whether a run is read that was done, by an older version perhaps."""
    return _recorded.get() is not None


def is_recorded(found: Any) -> bool:
    """Whether a class that was found only stands for a plug-in's."""
    return isinstance(found, type) and issubclass(found, Recorded)


OF_SCENARIOS = frozenset(point.group for point in (CONTROLLERS, RADIO_MODELS, FAULTS, INBOX_POLICIES, DYNAMICS))
"""The groups of what a scenario names."""


def find(point: ExtensionPoint, name: str, path: str, others: Collection[str] = ()) -> Any:
    """Find what `name` refers to: something shipped, an entry point, or `module:Class`.

    For messages, `path` is the settings key that holds the name, and `others` are names with a meaning elsewhere.

    Raises:
        SettingsError: there is no such thing, it cannot be imported, or it lacks something.
    """
    if (recorded := _recorded.get()) and point.group in OF_SCENARIOS and name not in point.shipped:
        return recorded
    target = name if ":" in name else point.shipped.get(name) or _entry_point(point, name, path, others)
    module, _, attribute = target.partition(":")
    note_plugin(module)
    try:
        found: Any = getattr(importlib.import_module(module), attribute)
    except BaseException as error:  # a plug-in may raise anything
        if is_interrupt(error):
            raise
        if (needs := extras.missing_by(error)) and blamed(error) is None:
            raise SettingsError([Problem(path, repr(name), needs)]) from None
        must, trace = f"must name a {point.what} that can be imported: {described(error)}", PluginError("", error).trace
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            must, trace = f"{must}; PYTHONPATH must name the folder of the module", ""
        raise SettingsError([Problem(path, repr(name), must, trace)]) from error
    missing = [attribute for attribute in point.needed if not hasattr(found, attribute)]
    if missing:
        raise SettingsError([Problem(path, repr(name), f"must be a {point.what} with {', '.join(missing)}")])
    if "Settings" in point.needed and not (isinstance(found.Settings, type) and is_dataclass(found.Settings)):
        raise SettingsError([Problem(path, repr(name), f"must be a {point.what} whose Settings is a dataclass")])
    return found


def _entry_point(point: ExtensionPoint, name: str, path: str, others: Collection[str]) -> str:
    installed = point.names()
    if name not in installed:
        known = sorted({*installed, *others})
        hint = checked.did_you_mean(name, known).rstrip()
        allowed = f"must be a known {point.what}: one of {', '.join(known)}, or module:Class"
        raise SettingsError([Problem(path, repr(name) + (hint and f"; {hint}"), allowed)])
    return installed[name]


def find_controller(mode: str, path: str = "control.mode") -> type[Any]:
    """Find the controller class that `control.mode` names. Raises SettingsError."""
    cls: type[Any] = find(CONTROLLERS, mode, path)
    return cls


def controller_settings(mode: str, options: Mapping[str, Any], shared: Any, path: str = "control") -> Any:
    """Check the controller's own settings; `shared` are the agent's.

    A `Settings` class may check its options against `shared` in a method `problems_with(shared)`.

    Raises:
        SettingsError: with every mistake, including those of the class itself.
    """
    return own_settings(CONTROLLERS, mode, options, path, "mode", shared)


def own_settings(
    point: ExtensionPoint, name: str, options: Any, path: str, name_key: str = "", shared: Any = None
) -> Any:
    """Check the options of what `name` refers to; without a `Settings` class it has none.

    `path` is the settings key of the options, and `name_key` the key beside them with the name; empty: the name is part
    of the path. A method `problems_with` of the settings gets `shared`.

    Raises:
        SettingsError: with every mistake, including those of the class itself.
    """
    name_path = ".".join(filter(None, (path, name_key)))
    cls = find(point, name, name_path)
    try:
        settings: Any = checked.load(getattr(cls, "Settings", NoSettings), options, path)
        check = getattr(settings, "problems_with", None)
        found = (check(shared) if check else None) or ()
        problems = [Problem(".".join(filter(None, (path, p.path))), p.given, p.allowed) for p in found]
        plain = checked.plain(settings)
        if name_key and name_key in plain:
            must = f"must have no option called {name_key} in its Settings"
            raise SettingsError([Problem(name_path, repr(name), must)])
        if not _is_plain(plain):
            raise TypeError("a value must be a bool, int, float, str, or tuple of these")
    except SettingsError:
        raise
    except BaseException as error:  # a plug-in may raise anything
        if is_interrupt(error):
            raise
        needs = "every field has a default and the type bool, int, float, str or tuple[one of these, ...]"
        must = f"must name a {point.what} with valid Settings: {described(error)}; {needs}"
        raise SettingsError([Problem(name_path, repr(name), must, PluginError("", error).trace)]) from error
    if problems:
        raise SettingsError(problems)
    return settings


def _is_plain(value: Any) -> bool:
    """Whether a settings file can hold the value."""
    if isinstance(value, dict):
        return all(map(_is_plain, value.values()))
    return all(map(_is_plain, value)) if isinstance(value, list) else type(value) in (bool, int, float, str)
