"""Export a recording: the formats, what each needs, and how the result gets its name."""

import importlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from subprocess import SubprocessError
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.export.snapshots import read_film
from deltaswarm_orchestrator.recording.finishing import write_complete_copy
from deltaswarm_orchestrator.recording.reader import RecordingError, recording_in, records
from deltaswarm_wire.extras import missing


class ExportError(CommandError):
    """A recording cannot be exported; the text says why, and what to do."""


@dataclass(frozen=True)
class Format:
    """A format. Its module here has `write(film, out, **options)`; without one, all is copied."""

    module: str
    suffix: str
    """Ending of the result's name; without a dot, the result is a folder."""
    needs: tuple[str, ...] = ()
    """Modules of the extra `export`."""


FORMATS = {
    "mcap": Format("", ".mcap"),
    "csv": Format("snapshots", "-csv"),
    "rosbag2": Format("rosbag2", "-rosbag2", ("rosbags",)),
    "rrd": Format("rrd", ".rrd", ("rerun",)),
    "mp4": Format("video", ".mp4", ("matplotlib",)),
}
"""The formats by their names on the command line."""

_NOT_REPLACED = "{} is not replaced: it holds other things than an export to {}"


def default_out(run: Path, name: str) -> Path:
    """Return the default path of the result: beside the run's folder or the recording's file."""
    run = run.resolve()
    base = run.name if run.is_dir() else run.name.removesuffix(".part").removesuffix(".mcap")
    return run.with_name(base + FORMATS[name].suffix)


class Exported(NamedTuple):
    """What was exported: whether the recording was complete, and what the user should know of the result."""

    is_complete: bool
    note: str | None = None


def export(run: Path, name: str, out: Path, *, force: bool = False, **options: Any) -> Exported:
    """Write the recording of a run to `out` in a format; `options` are the format's own.

    `out` appears when it is complete. An existing `out` is replaced only with `force`, and only if it is an earlier
    export of the same kind.

    Raises:
        ExportError: there is no recording, something that the format needs is missing, or `out` must be kept.
    """
    chosen = FORMATS[name]
    source = recording_in(run)
    if source.resolve() == out.resolve():
        raise ExportError(f"--out must be another file than the recording (got {out})")
    if os.path.lexists(out) and not force:
        raise ExportError(f"{out} exists; --force replaces it")
    is_kept = out.is_symlink() or (os.path.lexists(out) and out.is_dir() == chosen.suffix.startswith("."))
    if is_kept or (os.path.lexists(out) and (out.parent / seal.MANIFEST).exists()):  # a file of a run, perhaps
        raise ExportError(_NOT_REPLACED.format(out, name))
    check_out(out.parent, is_ours=False)
    try:
        write = _writer(source, chosen, name, options)
    except FileNotFoundError as error:
        raise ExportError(f"there is no recording at {error.filename}") from None
    except RecordingError as error:
        raise ExportError(str(error)) from None
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryFolder(out.parent) as scratch:
        part = scratch / out.name
        try:
            exported = write(part)
        except RecordingError as error:
            raise ExportError(str(error)) from None
        except (OSError, SubprocessError, RuntimeError) as error:  # also of an encoder that could not write
            if isinstance(error, RuntimeError) and "(os error " not in str(error):
                raise
            reason = getattr(error, "strerror", None) or error
            raise ExportError(f"{out} could not be written: {reason}; nothing was written", FAILED) from None
        if os.path.lexists(out):
            if not _is_like(out, part):
                raise ExportError(_NOT_REPLACED.format(out, name))
            out.rename(scratch / f"{out.name}.replaced")
        part.rename(out)
    return exported


def _writer(source: Path, chosen: Format, name: str, options: Mapping[str, Any]) -> Callable[[Path], Exported]:
    """Return the function that writes the result to a path."""
    if not chosen.module:
        next(records(source), None)  # which refuses another file
        return lambda out: Exported(write_complete_copy(source, out))
    if needs := missing(*chosen.needs, extra="export"):
        raise ExportError(f"the format {name} {needs}")
    module = importlib.import_module(f"deltaswarm_orchestrator.export.{chosen.module}")
    film = read_film(source)

    def write(out: Path) -> Exported:
        note = module.write(film, out, **options)
        return Exported(film.recording.complete, note)

    return write


def _is_like(old: Path, new: Path) -> bool:
    """Return whether `old` can be replaced: it has the form of `new`; of a folder all its files are in `new`, too."""
    if old.is_symlink() or old.is_dir() != new.is_dir():
        return False
    if not old.is_dir():
        return _head(old) == _head(new)
    return all((new / file.name).exists() and _is_like(file, new / file.name) for file in old.iterdir())


def _head(file: Path) -> bytes:
    """Return what tells a file's form: the columns of a table, else the first bytes; a video's are its first length."""
    if file.suffix == ".mp4":
        return b""
    with file.open("rb") as stream:
        return stream.readline() if file.suffix == ".csv" else stream.read(4)
