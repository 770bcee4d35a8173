"""A lock on a file: one program at a time, let go by the system when the program ends."""

import os
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import final

from spherekit.files.atomic import refused

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

FAR = 1 << 30
"""Where the byte lies that is locked on Windows, beyond the words of the file."""

TRIES = 20
"""How often a lock is asked for again when its file vanished in between."""


def take(handle: int) -> bool:
    """Lock an open file for this program; return whether no other one holds it."""
    try:
        if sys.platform == "win32":
            os.lseek(handle, FAR, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@final
class LockFile:
    """A locked file that says who holds it.

    The system lets go of the lock when its holder ends, however that happens, so a file
    that was left behind locks nothing.
    """

    def __init__(self, path: Path, handle: int) -> None:
        self.path = path
        self._handle = handle

    @classmethod
    def taken(cls, path: Path) -> "LockFile | str":
        """Return the lock, or who holds it, in words.

        Raises
        ------
        OutputError
            If the file cannot be made.
        """
        for _ in range(TRIES):
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            except FileNotFoundError:  # its folder was removed in between
                continue
            except OSError as error:
                raise refused(path.parent, "written", error) from None
            if not take(handle):
                os.close(handle)
                return _holder(path)
            if _still_there(path, handle):
                lock = cls(path, handle)
                lock._sign()
                return lock
            os.close(handle)
        return "another program that comes and goes"

    def _sign(self) -> None:
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        text = f"process {os.getpid()} on {socket.gethostname()} since {since}\n"
        with suppress(OSError):  # a full disk: the lock holds without words
            os.ftruncate(self._handle, 0)
            os.lseek(self._handle, 0, os.SEEK_SET)
            os.write(self._handle, text.encode())

    def release(self, remove: bool) -> None:
        """Let go; `remove` the file too, while it is still held."""
        if remove:
            with suppress(OSError):  # Windows removes no open file
                self.path.unlink(missing_ok=True)
        os.close(self._handle)


def _still_there(path: Path, handle: int) -> bool:
    """Return whether the path is still the file that was locked."""
    try:
        found, own = path.stat(), os.fstat(handle)
    except OSError:
        return False
    return (found.st_dev, found.st_ino) == (own.st_dev, own.st_ino)


def _holder(path: Path) -> str:
    try:
        words = path.read_text(encoding="utf-8", errors="replace")[:200].strip()
    except OSError:
        words = ""
    return words if words.startswith("process ") else "another program"
