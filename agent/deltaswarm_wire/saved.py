"""Objects whose state is part of a checkpoint, compiled or not."""

from typing import Any, Self


class Saved:
    """Base of the classes that pickle must save; it does not find the attributes of compiled ones itself."""

    __slots__ = ()

    def __new__(cls, *arguments: Any, **named: Any) -> Self:
        """Make an instance without attributes: the constructor of a compiled class would ask for its arguments."""
        return super().__new__(cls)

    def __getstate__(self) -> Any:
        names = getattr(type(self), "__mypyc_attrs__", None)
        if names is None:
            return super().__getstate__()
        return {name: getattr(self, name) for name in names if hasattr(self, name)}

    def __setstate__(self, state: Any) -> None:
        for attributes in state if isinstance(state, tuple) else (state,):
            for name, value in (attributes or {}).items():
                object.__setattr__(self, name, value)  # also of a frozen dataclass
