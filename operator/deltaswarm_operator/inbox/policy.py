"""The protocol of an inbox policy: new items in, what goes on which line out.

Pure: it has no clock and no randomness. A policy decides; `ledger.py` keeps the books, so that no policy can lose an
item: what it does not put on a line is held back, and can be opened.
"""

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol

from deltaswarm_operator.inbox.item import Item
from deltaswarm_scenario.operator_settings import INFO, SEVERITIES, InboxSettings
from deltaswarm_wire.foreign import Foreign
from deltaswarm_wire.plugins import INBOX_POLICIES, find

NEWEST, RANKED = "newest", "ranked"
"""How lines are listed and read: by their numbers, or by severity and then age."""


class Put(NamedTuple):
    """Items that go on one line of the inbox.

    Attributes:
        line: the line, by the number of the first item that was put on it.
        items: numbers of the items, in order.
        is_quiet: whether the line only counts them, and does not ask to be read for them.
    """

    line: int
    items: tuple[int, ...]
    is_quiet: bool = False


class Policy(Protocol):
    """One policy in one run. Made before the first step; its state is part of a checkpoint."""

    Settings: ClassVar[type[Any]]
    """A frozen dataclass whose fields are made by `deltaswarm_wire.checked.key`: the options in `operator.inbox`."""
    ORDER: ClassVar[str]
    """`NEWEST` or `RANKED`."""
    HELD: ClassVar[str]
    """Why an item is held back, for the tables and the page; empty if none is."""

    def __init__(self, settings: Any) -> None: ...

    def close_step(self, now_s: float, items: Sequence[Item]) -> Iterable[Put]:
        """Take in the new items of a closed step, oldest first; return what is shown from now on [simulated s]."""


def _puts(arrived: Sequence[Item], value: Any, now_s: float, items: Sequence[Item]) -> list[Put]:
    puts = list(value)
    for put in puts:
        numbers = (put.line, *put.items) if isinstance(put, Put) and isinstance(put.items, tuple | list) else ()
        if not numbers or any(type(number) is not int or not 0 <= number < len(arrived) for number in numbers):
            raise ValueError(f"must return Puts of items 0 to {len(arrived) - 1} (got {put!r:.80})")
    return puts


def _order(_: Any, value: Any) -> str:
    if value not in (NEWEST, RANKED):
        raise ValueError(f"must be {NEWEST!r} or {RANKED!r} (got {value!r:.80})")
    return str(value)


def _held(_: Any, value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"must be a text (got {value!r:.80})")
    return value


class ForeignPolicy(Foreign):
    """A policy from outside; its context is all items that have arrived, to which the ledger adds."""

    CHECKS: ClassVar = {"close_step": _puts, "ORDER": _order, "HELD": _held}


def policy_of(settings: InboxSettings, arrived: Sequence[Item]) -> Policy:
    """Make the policy that `operator.inbox.policy` names; `arrived` are all items, to which the ledger adds."""
    cls = find(INBOX_POLICIES, settings.policy, "operator.inbox.policy")
    policy: Policy = ForeignPolicy.make(cls, settings.own, context=arrived)
    _ = policy.ORDER, policy.HELD  # before hours are spent
    return policy


def urgency(item: Item) -> tuple[int, int]:
    """Sort items by severity, the most severe first, and then by age, the oldest first."""
    return -SEVERITIES.index(item.severity), item.number


def summed(items: Sequence[Item]) -> list[Put]:
    """Put items on one line, which counts those of severity info, unless there are no others."""
    listed = sorted(item.number for item in items if item.severity != INFO)
    counted = sorted(item.number for item in items if item.severity == INFO)
    if not listed:
        listed, counted = counted[:1], counted[1:]
    return [Put(listed[0], tuple(listed)), *([Put(listed[0], tuple(counted), is_quiet=True)] if counted else [])]


def alone(items: Iterable[Item]) -> list[Put]:
    """Put each item on a line of its own."""
    return [Put(item.number, (item.number,)) for item in items]
