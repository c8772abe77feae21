"""Exit codes by which one part tells another what ailed it."""

import errno

FAILED = 1

NO_ROOM = 74
"""A file could not be written: the disk is full, or refuses (`EX_IOERR` of sysexits.h)."""

_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG, errno.EROFS}


def exit_code_of(error: Exception) -> int:
    """The exit code of a part that ends by an error."""
    return NO_ROOM if isinstance(error, OSError) and error.errno in _DISK else FAILED
