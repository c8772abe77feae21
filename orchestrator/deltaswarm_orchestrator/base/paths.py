"""Check paths and addresses that a user gives, before anything runs: they exist, can be written, or are free."""

import os
import socket
import stat
from collections.abc import Collection, Mapping
from itertools import chain, count
from pathlib import Path

from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_wire.checked import did_you_mean
from deltaswarm_wire.child import NO_ROOM, exit_code_of
from deltaswarm_wire.session import OVER_TCP, host_and_port, protocol_of

LEVELS = 3
"""Levels of folders below a folder of results: `sessions/S` has `participant-1/RUN/logs`."""

FILE_ENDINGS = {*(".csv", ".tsv", ".parquet", ".json", ".toml", ".html", ".md", ".mcap"), *(".png", ".svg", ".pdf")}

_ODD = "{} must be a file or a folder (got a named pipe or a device)"


def free_folder(folder: Path) -> Path:
    """Return the folder, or its name with a number if a run has it; an interrupted run keeps its folder, too."""
    numbered = (folder.with_name(f"{folder.name}-{number}") for number in count(2))
    free = (path for path in chain([folder], numbered) if not path.exists() and not part_of(path).exists())
    return next(free)


def check_files(folder: Path, levels: int = LEVELS) -> None:
    """Check that a folder of results has only files and folders, and no folder by the name of a file.

    A reader of a named pipe would wait forever, and a writer would notice a folder in a file's place only after all
    runs. Sockets are left out: a run under way has one, and nobody can open it as a file.

    Args:
        folder: the folder, which need not exist.
        levels: how many levels of folders below it are looked at.
    """
    if _is_odd(folder):
        raise CommandError(_ODD.format(folder))
    try:
        with os.scandir(folder) as entries:
            others = sorted(entry.path for entry in entries if not entry.is_file(follow_symlinks=False))
    except (OSError, ValueError):  # a file, or what those complain of who read it
        return
    for path in map(Path, others):
        if _is_odd(path):
            raise CommandError(_ODD.format(path))
        if path.is_dir():
            if path.suffix in FILE_ENDINGS:
                raise CommandError(f"{path} must be a file (got a folder): move it away")
            if levels and not path.is_symlink():
                check_files(path, levels - 1)


def _is_odd(path: Path) -> bool:
    """Whether something is there that is neither file, folder nor socket."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # nothing, or gone by now
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode) or stat.S_ISSOCK(mode))


def check_out(folder: Path, name: str = "--out", *, is_ours: bool = True, among: Collection[str] = ()) -> None:
    """Check that a folder, which need not exist, can be made and written, by a file without a name.

    Args:
        folder: the folder.
        name: the option that names it.
        is_ours: whether it is for results alone, and is checked by `check_files`, without the folders below it.
        among: if it exists and is not empty, it must hold a file or folder of one of these names.
    """
    if is_ours and os.path.isdir(folder):  # unlike `Path.is_dir`, False for an impossible name
        check_files(folder, 0)
    import tempfile  # which the options of a command need not load

    nearest = next((path for path in (folder, *folder.absolute().parents) if os.path.lexists(path)), folder)
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        must = "must be a folder that can be made and written"
        code = FAILED if exit_code_of(error) == NO_ROOM else None
        raise CommandError(f"{name} {must} (got {str(folder)!r}; {nearest}: {error.strerror})", code) from None
    names = {path.name for path in folder.glob("[!.]*")} if among else set()
    if names and names.isdisjoint(among):
        raise CommandError(
            f"{name} must be a new folder, or one with {' or '.join(among)} (got {folder}, which holds other things)"
        )


def part_of(run: Path) -> Path:
    """Return where a run is until it is complete."""
    return run.with_name(f"{run.name}.part")


def must_exist(path: Path, name: str, what: str, *, or_part: bool = False) -> None:
    """Check that there is something at a path, as `check_files` does; the message says where it was looked for.

    With `or_part` it may also be at PATH.part, where a run is until it is complete.
    """
    part = part_of(path) if path.name else path
    has_part = os.path.exists(part)  # unlike `Path.exists`, False for an impossible name
    if os.path.exists(path) or (or_part and has_part):
        for folder in (path, part):
            check_files(folder)
        return
    hint = f"; {part} has what is left of an interrupted run" if has_part else ""
    if not hint and path.parent.is_dir():
        near = did_you_mean(path.name, (other.name for other in path.parent.iterdir()))
        hint = near and f"; {near.strip()}"
    raise CommandError(f"{name} must be {what} (got {str(path)!r}; there is nothing at {path.absolute()}{hint})")


def check_ports(endpoints: Mapping[str, str]) -> None:
    """Check that a process can listen at endpoints, by the options that name them; those not over TCP are left out."""
    seen: dict[tuple[str, int], str] = {}
    for option, endpoint in endpoints.items():
        if protocol_of(endpoint) not in OVER_TCP:
            continue
        host, port = host_and_port(endpoint)
        if port and (other := seen.setdefault((host, port), option)) != option:
            raise CommandError(f"{option} must be another address than {other} (got {host}:{port})")
        try:
            socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET).close()
        except OSError as error:
            reason = (error.strerror or str(error)).partition(" (while ")[0]
            must = "must be an address of this machine with a free port"
            raise CommandError(f"{option} {must} (got {host}:{port}: {reason}); choose another") from None
