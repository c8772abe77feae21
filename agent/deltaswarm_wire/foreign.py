"""The object of a plug-in, as deltaswarm calls it: what it raises and what it returns is checked where it enters.

What comes with deltaswarm is not wrapped, and pays nothing.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar

from deltaswarm_wire.plugin_errors import PACKAGES, PluginError, defined_at, is_interrupt, note_plugin


def is_foreign(thing: object) -> bool:
    """Whether a class or function does not come with deltaswarm."""
    return str(getattr(thing, "__module__", "")).partition(".")[0] not in PACKAGES


def name_of(kind: Any) -> str:
    """Return `module:Class`."""
    return f"{kind.__module__}:{kind.__qualname__}"


def called(
    name: str,
    function: Callable[..., Any],
    *arguments: Any,
    at: object = None,
    passes: tuple[type[BaseException], ...] = (),
) -> Any:
    """Call a function of a plug-in, and return what it returns.

    Args:
        name: names the function in messages.
        function: the function.
        arguments: its arguments.
        at: whose definition is shown if no frame of the plug-in raised, as for a wrong signature; default: `function`.
        passes: types of errors that are not its failure.

    Raises:
        PluginError: the function raised.
    """
    try:
        return function(*arguments)
    except BaseException as error:  # a plug-in may raise anything
        if is_interrupt(error) or isinstance(error, passes):
            raise
        raise PluginError(f"{name} failed", error, at or function) from error


class Foreign:
    """A plug-in's object whose members are checked where deltaswarm reads or calls them.

    Args:
        plugin: the object.
        context: what the checks need to know of the run; it must be picklable, as the object is.
    """

    CHECKS: ClassVar[Mapping[str, Callable[..., Any]]] = {}
    """Checks by member: functions of the context, of the member's value or what its call returns, and of the call's
    arguments. A check returns the value to go on with, or raises ValueError: "must ... (got ...)"."""
    PASSES: ClassVar[tuple[type[BaseException], ...]] = ()
    """Errors by which the plug-in is meant to refuse something."""

    def __init__(self, plugin: Any, context: Any = None) -> None:
        self._plugin, self._context = plugin, context

    @classmethod
    def make(cls, kind: Any, *arguments: Any, context: Any = None) -> Any:
        """Make an object of a class, and wrap it unless the class comes with deltaswarm.

        Raises:
            PluginError: the constructor of a class from outside raised.
        """
        if not is_foreign(kind):
            return kind(*arguments)
        return cls(called(name_of(kind), kind, *arguments, passes=cls.PASSES), context)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # pickle asks before there are attributes
            raise AttributeError(name)
        plugin, check = self._plugin, self.CHECKS.get(name)
        where = f"{name_of(type(plugin))}.{name}"
        value = called(where, getattr, plugin, name, at=type(plugin))
        if callable(value):
            return partial(self._call, where, value, check)
        return self._checked(where, type(plugin), check, value)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        note_plugin(type(self._plugin).__module__)

    def _call(self, where: str, method: Callable[..., Any], check: Callable[..., Any] | None, *arguments: Any) -> Any:
        # An inherited method of deltaswarm's is not the plug-in's place.
        at = method if is_foreign(method) else type(self._plugin)
        value = called(where, method, *arguments, at=at, passes=self.PASSES)
        return self._checked(where, at, check, value, *arguments)

    def _checked(
        self, where: str, function: object, check: Callable[..., Any] | None, value: Any, *arguments: Any
    ) -> Any:
        if check is None:
            return value
        try:
            return check(self._context, value, *arguments)
        except BaseException as error:  # what the plug-in returned may raise anything, too, such as a generator
            if is_interrupt(error):
                raise
            if str(error).startswith("must "):
                raise PluginError(f"{where} {error} ({defined_at(function)})") from None
            raise PluginError(f"{where} failed", error, function) from error
