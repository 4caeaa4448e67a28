"""Output files are whole or absent."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

__all__ = ["write_whole"]


def write_whole(path: str | Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a temporary file beside ``path``, then rename it to ``path``.

    The temporary file keeps the suffix, from which plotting libraries read the format. It is
    removed when ``write`` fails, and ``path`` is left as it was.

    Raises:
        OSError: the file, or another one that ``write`` writes, cannot be written; or what is there
            is no regular file, such as a device.
    """
    target = Path(os.path.realpath(path))  # a link keeps pointing to what is replaced
    temporary = target.with_name(f".{target.stem}.{os.getpid()}.tmp{target.suffix}")
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "is there and is no file that can be replaced", str(path))
    try:
        write(temporary)
        temporary.replace(target)
    except OSError as error:
        named = error.filename not in (None, str(temporary))
        where = str(error.filename) if named else str(path)
        raise OSError(error.errno, error.strerror or str(error), where) from error
    finally:
        temporary.unlink(missing_ok=True)
