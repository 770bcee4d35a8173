"""A lock on a file that one program holds; the system releases it when the program ends."""

import errno
import os
import socket
import time
from contextlib import suppress
from pathlib import Path

from filelock import BaseFileLock as BaseFileLock
from filelock import FileLock, Timeout, lock_descriptor

from spherekit.errors import OutputError
from spherekit.storage.atomic_write import refused

NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)
"""What systems answer where a disk knows no locks."""


def locked(path: Path) -> BaseFileLock | str:
    """Return the lock on a file, held until it is released, or who holds it, in words.

    The file says who holds it; one that was left behind locks nothing.

    Raises
    ------
    OutputError
        If the file cannot be made, is one that no lock has made, or the disk knows no
        locks.
    """
    if path.is_symlink() or (path.exists() and not _is_lock(path)):
        raise OutputError(
            f"{str(path)!r} is not the lock of spherekit that belongs there; choose "
            "another folder, or move it away"
        )
    lock = FileLock(path, 0.1, fallback_to_soft=False, on_acquired=_sign)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire(poll_interval=0.01)
    except Timeout:
        return _holder(path)
    except OSError as error:
        what = "locked" if error.errno in NO_LOCKS else "written"
        raise refused(path.parent, what, error) from None
    return lock


def take(handle: int) -> bool:
    """Lock an open file until it is closed; return whether no other program holds it."""
    return lock_descriptor(handle, blocking=False)


def _sign(handle: int) -> None:
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    text = f"process {os.getpid()} on {socket.gethostname()} since {since}\n"
    with suppress(OSError):  # a full disk: the lock holds without words
        os.ftruncate(handle, 0)
        os.lseek(handle, 0, os.SEEK_SET)
        os.write(handle, text.encode())


def _is_lock(path: Path) -> bool:
    """Return whether what is there is a lock: empty, or signed."""
    try:
        return path.is_file() and path.read_bytes()[:8] in (b"", b"process ")
    except OSError:  # Windows lends no locked file
        return True


def _holder(path: Path) -> str:
    try:
        words = path.read_text(encoding="utf-8", errors="replace")[:200].strip()
    except OSError:  # Windows lends no locked file
        words = ""
    return words if words.startswith("process ") else "another program"
