"""Closed steps on their way to the operator: each arrives once, whoever is killed when."""

from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_world.core.retransmit_buffer import RetransmitBuffer, StepMessages


class Listener:
    """An operator: counts closed steps, saves now and then, and forgets what it had not saved when it is killed."""

    def __init__(self) -> None:
        self.reports: list[bytes] = []
        self.closed: list[tuple[bytes, ...]] = []
        self.saved: list[tuple[bytes, ...]] = []

    def clock(self, data: bytes) -> None:
        assert data == b"%d" % len(self.closed), "in order, none missing, none twice"
        self.closed.append(tuple(self.reports))
        self.reports.clear()

    def save(self) -> int:
        """The newest step that is on disk."""
        self.saved = list(self.closed)
        return len(self.saved) - 1

    def die(self) -> int:
        """Another one stands in; what it has."""
        self.closed = list(self.saved)
        self.reports.clear()
        return len(self.saved) - 1


@given(st.lists(st.sampled_from(["step", "step", "step", "save", "gone", "back"]), max_size=80))
def test_each_step_arrives_once(events: list[str]) -> None:
    """Whatever the order of steps, confirmations, deaths and returns; and nothing confirmed is kept."""
    operator = Listener()
    buffer = RetransmitBuffer(operator.reports.append, operator.clock)
    wanted: list[tuple[bytes, ...]] = []
    is_there = True
    for event in [*events, "back"]:
        if event == "step":
            step = len(wanted)
            wanted.append(tuple(b"%d/%d" % (step, number) for number in range(step % 3)))
            buffer.add(StepMessages(step, list(wanted[-1]), b"%d" % step), now=is_there)
        elif event == "save" and is_there:
            buffer.confirm(operator.save())
        elif event == "gone":
            is_there = False
        elif event == "back" and not is_there:
            buffer.resend_after(operator.die())
            is_there = True
        assert buffer.confirmed == len(operator.saved) - 1
        assert len(buffer._kept) == len(wanted) - len(operator.saved)
    assert operator.closed == wanted


def test_who_has_all_is_told_once_more_that_it_was_the_last() -> None:
    """An operator that is killed between its last confirmation and its end: another one ends in its place."""
    reports: list[bytes] = []
    clocks: list[bytes] = []
    buffer = RetransmitBuffer(reports.append, clocks.append)
    buffer.add(StepMessages(0, [b"a"], b"0"), now=True)
    buffer.add(StepMessages(1, [b"b"], b"1", last=True), now=True)
    buffer.resend_after(1)
    assert reports == [b"a", b"b"]
    assert clocks == [b"0", b"1", b"1"]
