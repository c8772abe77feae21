"""Exit codes that tell one part why another ended."""

import errno

FAILED = 1

NO_ROOM = 74
"""A file could not be written: the disk is full or faulty (`EX_IOERR` of sysexits.h)."""

WORLD_LOST = 69
"""An operator's world, or the link to it, went before the last step (`EX_UNAVAILABLE` of sysexits.h)."""

LIMIT_REACHED = 71
"""The system allows no more processes, threads, open files or memory (`EX_OSERR` of sysexits.h)."""

_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG, errno.EROFS}


def exit_code_of(error: Exception) -> int:
    """The exit code of a part that ends with an error."""
    return NO_ROOM if isinstance(error, OSError) and error.errno in _DISK else FAILED
