"""The pages of the paper's control: their examples, numbers and counts are the code's.

`python -m tests.docs.test_frames` prints the examples anew.
"""

import inspect
import re
from dataclasses import asdict
from pathlib import Path

from deltaswarm_agent.controllers.paper import beliefs, finds, frames, returning, timers, whereabouts
from deltaswarm_agent.controllers.paper.frames import (
    Attending,
    Averages,
    Descendant,
    Gone,
    Leaving,
    Member,
    RecruitmentOrder,
    Relocating,
    Sighting,
    Tried,
)
from deltaswarm_wire import codec
from tests.support.annotating import Example, Page, Shape, assert_is_the_codes, message
from tests.support.tiers import in_one_test
from tests.unit.agent.paper import test_protocol_machine as machine

FOLDER = Path(__file__).parents[2] / "agent" / "deltaswarm_agent" / "controllers" / "paper"


def _example(frame: frames.PaperFrame, **arrays: Shape) -> Example:
    sender = frame.sender

    def decode(payload: bytes) -> frames.PaperFrame:
        frames.encoded.clear()  # else nothing would be decoded
        return frames.decode(sender, payload)

    names = [name for name in type(frame)._fields[1:] if getattr(frame, name) is not None or name != "averages"]
    return Example(frame, frames.encode, decode, message("frame", ("kind", *names), **arrays))


EXAMPLES = {
    "attending": _example(Attending(4, 5250, 4700, 3, 5250, 4700)),
    "adaptive": _example(
        Attending(4, 5250, 4700, 3, 5250, 4700, Averages(812, 1430, 2417, 1962, 315)),
        averages=Shape("averages", Averages._fields),
    ),
    "bandit": _example(
        Attending(4, 5250, 4700, 3, 5250, 4700, Averages(812, 1430, 2417, 1962, 315, Tried(2, 3200, 1500, 60_000))),
        averages=Shape("averages", (*Averages._fields[:-1], Shape("tried", Tried._fields))),
    ),
    "member": _example(
        Member(
            *(6, 5820, 4800, False, (4, 6), 412, 1),
            (Descendant(9, 6, 6400, 4500, 0),),
            (Sighting(3, 5250, 4700, 0), Sighting(5, 6100, 4950, 2)),
            (Gone(2, 7),),
            RecruitmentOrder(9, 5300, 5400, 420, 11),
        ),
        path=Shape("path"),
        table=Shape("table", Descendant._fields, "flat"),
        events=Shape("events", Sighting._fields, "flat"),
        gone=Shape("gone", Gone._fields, "flat"),
        order=Shape("order", RecruitmentOrder._fields),
    ),
    "relocating": _example(Relocating(9, 6213, 4631)),
    "leaving": _example(Leaving(9, 5000, 4200)),
}

FRAMES = Page(FOLDER / "FRAMES.md", EXAMPLES)
TREES = Page(FOLDER / "TREES.md", {})
SOURCES = (frames, timers, whereabouts, beliefs, finds, returning, machine)


@in_one_test("name", EXAMPLES)
def test_an_example_is_what_the_code_sends(name: str) -> None:
    """Every byte of the page's example, with its annotation, is the code's, and decodes to what the page says."""
    FRAMES.assert_shows(name)


def test_every_kind_of_frame_has_its_example_and_its_number() -> None:
    FRAMES.assert_shows_no_other()
    assert {type(example.message) for example in EXAMPLES.values()} == set(frames._KINDS)
    for kind in ("ATTENDING", "MEMBER", "RELOCATING", "LEAVING"):
        assert f"| {getattr(frames, kind)} | {kind.lower()} |" in FRAMES.text


@in_one_test("field", Member._fields[3:])
def test_each_item_of_a_members_frame_is_explained(field: str) -> None:
    """A row of the page's table for each, and rows by the names of their numbers."""
    (row,) = re.findall(rf"^\| `{field}` \| (.*) \|$", FRAMES.text, re.MULTILINE)
    rows = {"table": Descendant, "events": Sighting, "gone": Gone, "order": RecruitmentOrder, "averages": Averages}
    if field in rows:
        assert ", ".join(rows[field]._fields) in row


@in_one_test(("name", "number"), FRAMES.constants() + TREES.constants())
def test_a_number_of_the_pages_is_the_codes(name: str, number: str) -> None:
    """Each row of a table that begins with a constant's name gives that constant."""
    assert_is_the_codes(name, number, SOURCES)


def test_the_pages_name_all_limits_and_timers() -> None:
    """Of the frames, and of the rules of the trees."""
    limits = {name for name in vars(frames) if name.startswith("MAX_") and not hasattr(codec, name)}
    assert limits <= {name for name, _ in FRAMES.constants()}
    rules = {
        name
        for source in (timers, whereabouts, beliefs, finds, returning)
        for name, value in vars(source).items()
        if re.fullmatch(r"[A-Z_]+_(M|S)|MAX_HOPS", name) and isinstance(value, int | float)
    }
    assert rules <= {name for name, _ in TREES.constants()}


def test_the_least_steps_of_the_page_are_the_codes() -> None:
    """Each timer's row says how many steps it has at least, however long they are."""
    least = asdict(timers.timers(1e6))
    rows = dict(re.findall(r"^\| `([A-Z_]+)_S` \| \d+ \| (\d+) \|", TREES.text, re.MULTILINE))
    assert {name.lower(): int(steps) for name, steps in rows.items()} == least


def test_what_holds_is_held_by_a_test() -> None:
    """Each row of the table under "What holds" gives a number of the machine, and names its method that holds it."""
    rows = re.findall(r"^\| `([A-Z_]+_STEPS)` \| \d+ \|.*\| `(\w+)` \|$", TREES.section("What holds"), re.MULTILINE)
    assert [name for name, _ in rows] == ["CYCLE_STEPS", "ROOTLESS_STEPS", "GHOST_STEPS", "HEALED_STEPS"]
    for name, method in rows:
        assert name in inspect.getsource(getattr(machine.TreeProtocol, method))


if __name__ == "__main__":
    print("\n".join(FRAMES.example(name) for name in EXAMPLES))
