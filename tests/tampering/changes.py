"""Change one place of a stored result at random, let its readers look, and judge what they said."""

import copy
import re
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.checked import SettingsError
from tests.tampering.stores import FOUND, Store

REFUSALS = (CommandError, SettingsError, OSError, ValueError)
"""What commands turn into a line."""

REFUSED, FOUND_BY_READER, HARMLESS, SILENT, CRASHED = "refused", "found", "harmless", "SILENT", "CRASHED"

NOT_RESULTS = ("logs", "scratch", "figures", "sweep")
"""Folders within a stored result that hold none of its results, or a result of another kind."""

Change = Callable[[bytes, Random], bytes]


def flip(data: bytes, random: Random) -> bytes:
    """Change up to eight bytes."""
    changed = bytearray(data)
    for _ in range(random.randint(1, 8)):
        changed[random.randrange(len(data))] ^= random.randint(1, 255)
    return bytes(changed)


def truncate(data: bytes, random: Random) -> bytes:
    """Cut the end off."""
    return data[: random.randrange(len(data))]


def remove_line(data: bytes, random: Random) -> bytes:
    """Remove a line."""
    lines = data.splitlines(keepends=True)
    del lines[random.randrange(len(lines))]
    return b"".join(lines)


def change_cell(data: bytes, random: Random) -> bytes:
    """Replace one digit by another: a table or record stays well-formed."""
    digits = [match.start() for match in re.finditer(rb"\d", data)]
    if not digits:
        return flip(data, random)
    place = random.choice(digits)
    digit = random.choice([other for other in b"0123456789" if other != data[place]])
    return data[:place] + bytes([digit]) + data[place + 1 :]


CHANGES: tuple[Change, ...] = (flip, truncate, remove_line, change_cell)


def tamper(kind: str, store: Store, places: int, random: Random) -> Iterator[tuple[str, str]]:
    """Change places of a stored result one after the other; yield each verdict with what was changed."""
    whole = store.read(store.folder)
    assert whole is not FOUND
    expected = copy.deepcopy(whole)
    files = sorted(_files(kind, store.folder))
    for _ in range(places):
        file = random.choice(files)
        before = file.read_bytes()
        what, after = _changed(store, file, files, before, random)
        if after == before:
            yield HARMLESS, f"{what} (nothing changed)"
            continue
        with _instead(file, before, after):
            try:
                seen = store.read(store.folder)
                verdict = FOUND_BY_READER if seen is FOUND else HARMLESS if seen == expected else SILENT
            except REFUSALS:
                verdict = REFUSED
            except Exception as error:  # a traceback for whoever gives the command
                verdict, what = CRASHED, f"{what}: {error!r}"
        yield verdict, what


def _files(kind: str, folder: Path) -> Iterator[Path]:
    for file in folder.rglob("*"):
        parts = file.relative_to(folder).parts
        if not file.is_file() or not file.stat().st_size or {*NOT_RESULTS} & {*parts[:-1]}:
            continue
        if kind != "recording" or file.suffix == ".mcap":
            yield file


def _changed(store: Store, file: Path, files: list[Path], before: bytes, random: Random) -> tuple[str, bytes | None]:
    """Return what is done, and the file's new content; None: it is deleted."""
    name = str(file.relative_to(store.folder))
    choice = random.randrange(len(CHANGES) + 3)
    if choice < len(CHANGES):
        change = CHANGES[choice]
        return f"{change.__name__} {name}", change(before, random)
    if choice == len(CHANGES):
        return f"delete {name}", None
    other = store.other / name
    if choice == len(CHANGES) + 1 and other.exists():
        return f"{name} of another run", other.read_bytes()
    twin = random.choice(files)
    return f"{twin.relative_to(store.folder)} in place of {name}", twin.read_bytes()


@contextmanager
def _instead(file: Path, before: bytes, after: bytes | None) -> Iterator[None]:
    if after is None:
        file.unlink()
    else:
        file.write_bytes(after)
    try:
        yield
    finally:
        file.write_bytes(before)


def judge(stores: dict[str, Store], places: int, seed: int) -> tuple[dict[str, Counter[str]], list[str]]:
    """Change about as many places of each kind; return the counts of verdicts by kind, and what must not be."""
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in stores}
    wrong = []
    for number, (kind, store) in enumerate(stores.items()):
        share = places // len(stores) + (number < places % len(stores))
        for verdict, what in tamper(kind, store, share, Random(f"{seed}/{kind}")):
            counts[kind][verdict] += 1
            if verdict in (SILENT, CRASHED):
                wrong.append(f"{kind}: {verdict}: {what}")
    return counts, wrong
