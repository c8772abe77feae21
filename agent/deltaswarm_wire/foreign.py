"""A wrapper of plug-ins' objects, which checks what they return and turns what they raise into a `PluginError`.

What comes with deltaswarm is not wrapped, and pays nothing.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar

from deltaswarm_wire.plugin_errors import PACKAGES, PluginError, is_interrupt, note_plugin


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
    """Call a function of a plug-in; return what it returns, and turn what it raises into a PluginError.

    The message has `name` and the definition of `at` (default: the function); errors in `passes` are not its failure.
    """
    try:
        return function(*arguments)
    except BaseException as error:  # a plug-in may raise anything
        if is_interrupt(error) or isinstance(error, passes):
            raise
        raise PluginError(f"{name} failed", error, at or function) from error


class Foreign:
    """A plug-in's object whose members are checked where deltaswarm reads or calls them.

    The checks get `context`, what they need to know of the run; it must be picklable, as the object is.
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
        """Make an object of a class, and wrap it unless the class comes with deltaswarm."""
        if not is_foreign(kind):
            return kind(*arguments)
        return cls(called(name_of(kind), kind, *arguments, passes=cls.PASSES), context)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # pickle asks before there are attributes
            raise AttributeError(name)
        try:
            value = getattr(self._plugin, name)
        except BaseException as error:
            raise self._failed(name, type(self._plugin), error) from error
        check = self.CHECKS.get(name)
        if callable(value):
            return partial(self._call, name, value, check)
        return value if check is None else self._checked(name, type(self._plugin), check, value)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        note_plugin(type(self._plugin).__module__)

    def _call(self, name: str, method: Any, check: Callable[..., Any] | None, *arguments: Any) -> Any:
        try:
            value = method(*arguments)
        except BaseException as error:  # a plug-in may raise anything
            raise self._failed(name, method, error) from error
        return value if check is None else self._checked(name, method, check, value, *arguments)

    def _checked(self, name: str, method: Any, check: Callable[..., Any], value: Any, *arguments: Any) -> Any:
        try:
            return check(self._context, value, *arguments)
        except BaseException as error:  # what the plug-in returned may raise anything, too, such as a generator
            failed = self._failed(name, method, error)
            if not str(error).startswith("must "):
                raise failed from error
            raise PluginError(f"{self._named(name)} {error} ({failed.where})") from None

    def _failed(self, name: str, method: object, error: BaseException) -> PluginError:
        """Return the error to report. Raises the original if it is an interrupt or the plug-in may refuse by it."""
        if is_interrupt(error) or isinstance(error, self.PASSES):
            raise error
        # An inherited method of deltaswarm's is not the plug-in's place.
        at = method if is_foreign(method) else type(self._plugin)
        return PluginError(f"{self._named(name)} failed", error, at)

    def _named(self, name: str) -> str:
        return f"{name_of(type(self._plugin))}.{name}"
