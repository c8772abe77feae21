"""Export a recording: the formats, what each needs, and how the result gets its name."""

import importlib
import os
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.export.snapshots import read_film
from deltaswarm_orchestrator.recording.reader import RecordingError, recording_in


class ExportError(CommandError):
    """A recording cannot be exported; the text says why, and what to do."""


@dataclass(frozen=True)
class Format:
    """A format. Its module in this folder has `write(film, out)` and imports `library`."""

    module: str
    suffix: str
    """Ending of the result's name; without a dot, the result is a folder."""
    library: str = ""


FORMATS = {
    "csv": Format("tables", "-csv"),
    "rosbag2": Format("rosbag2", "-rosbag2", "rosbags"),
    "rrd": Format("rrd", ".rrd", "rerun"),
    "mp4": Format("video", ".mp4"),
}
"""The formats by their names on the command line."""


def default_out(run: Path, name: str) -> Path:
    """Return the default path of the result: beside the run's folder or the recording's file."""
    run = run.resolve()
    base = run.name if run.is_dir() else run.name.removesuffix(".part").removesuffix(".mcap")
    return run.with_name(base + FORMATS[name].suffix)


def export(run: Path, name: str, out: Path, *, force: bool = False) -> bool:
    """Write the recording of a run to `out` in a format; return whether the recording was complete.

    `out` appears when it is complete. An existing `out` is replaced only with `force`, and only if it is an earlier
    export of the same kind.

    Raises:
        ExportError: there is no recording, something that the format needs is missing, or `out` must be kept.
    """
    chosen = FORMATS[name]
    if os.path.lexists(out) and not force:
        raise ExportError(f"{out} exists; --force replaces it")
    try:
        module = importlib.import_module(f"deltaswarm_orchestrator.export.{chosen.module}")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != chosen.library:
            raise
        raise ExportError(f"--format {name} needs {chosen.library}: pip install 'deltaswarm[export]'") from None
    try:
        film = read_film(recording_in(run))
    except FileNotFoundError as error:
        raise ExportError(f"there is no recording at {error.filename}") from None
    except RecordingError as error:
        raise ExportError(str(error)) from None
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=".export-", dir=out.parent) as scratch:
        part = Path(scratch) / out.name
        module.write(film, part)
        if os.path.lexists(out):
            if not _is_like(out, part):
                raise ExportError(f"{out} is not replaced: it holds other things than an export to {name}")
            out.rename(Path(scratch) / f"{out.name}.replaced")
        part.rename(out)
    return film.recording.complete


def _is_like(old: Path, new: Path) -> bool:
    """Return whether `old` can be replaced: a file by a file, or a folder whose files are all in `new` too."""
    if old.is_symlink() or old.is_dir() != new.is_dir():
        return False
    return not old.is_dir() or {file.name for file in old.iterdir()} <= {file.name for file in new.iterdir()}
