"""Locks on files; only one program at a time can have the lock of a file.

The operating system releases a lock when the program ends, whatever the reason.
"""

import errno
import os
import socket
import time
from contextlib import suppress
from pathlib import Path

from filelock import BaseFileLock as BaseFileLock
from filelock import FileLock, Timeout, lock_descriptor

from spherekit.errors import OutputError
from spherekit.storage.atomic_write import output_error

NO_LOCKS_ERRORS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)
"""Error numbers of the operating system on a disk that does not support locks."""


def acquire_lock(path: Path) -> BaseFileLock | str:
    """Lock a file against other programs, or find out which program has locked it.

    The program that has the lock writes its process number into the file.

    Parameters
    ----------
    path
        The lock file, which is created with the folders around it.

    Returns
    -------
    The lock, which ends when it is released or when this program ends. If another program
    has the lock, the result is a text that names this program.

    Raises
    ------
    OutputError
        If the file cannot be created, if it is a file of another kind, or if the disk does
        not support locks.
    """
    # Another program may have the lock for a moment only, so the call waits 0.1 s. Without
    # `fallback_to_soft` the call fails on disks without locks.
    lock = FileLock(path, timeout=0.1, fallback_to_soft=False, on_acquired=_write_owner)
    try:
        if path.is_symlink() or (path.exists() and not _is_lock_file(path)):
            raise OutputError(
                f"{str(path)!r} has the name of a lock file of spherekit, but is not one; "
                "choose another folder, or move it away"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire(poll_interval=0.01)
    except Timeout:
        return _read_owner(path)
    except OSError as error:
        what = "locked" if error.errno in NO_LOCKS_ERRORS else "written"
        raise output_error(path.parent, what, error) from None
    return lock


def try_lock(descriptor: int) -> bool:
    """Lock an open file until it is closed; return whether that was possible.

    The lock keeps other programs from using the file at the same time. The result is False
    if another program has locked the file.
    """
    return lock_descriptor(descriptor, blocking=False)


def _write_owner(descriptor: int) -> None:
    """Write into an open lock file which process has locked it, and since when."""
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    text = f"process {os.getpid()} on {socket.gethostname()} since {since}\n"
    with suppress(OSError):  # on a full disk the lock works without the text
        os.ftruncate(descriptor, 0)
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, text.encode())


def _is_lock_file(path: Path) -> bool:
    """Return whether an existing file is a lock file: empty, or with an owner."""
    try:
        return path.is_file() and path.read_bytes()[:8] in (b"", b"process ")
    except OSError:  # Windows does not let others read a locked file
        return True


def _read_owner(path: Path) -> str:
    """Return the text of a lock file that says who has locked it."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")[:200].strip()
    except OSError:  # Windows does not let others read a locked file
        text = ""
    return text if text.startswith("process ") else "another program"
