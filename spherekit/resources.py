"""The processor cores and the memory that this process may use."""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from spherekit.errors import SpherekitError

MEMBERSHIP, GROUPS = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")
"""Where Linux says which control groups this process is in, and their limits."""


def usable_cores() -> int:
    """Return how many cores this process may use, at least 1."""
    try:
        return max(1, len(os.sched_getaffinity(0)))
    except AttributeError:  # not on Windows and macOS
        return os.cpu_count() or 1


def usable_memory() -> int | None:
    """Return the bytes of memory that this process may use, None where nothing says.

    That is the least of the machine's, of what is left of the address space
    (``ulimit -v``), and of the limits of the control groups (containers).
    """
    limits = list(_group_limits())
    with suppress(AttributeError, ValueError, OSError):
        limits.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    space = address_space()
    if space is not None:
        limits.append(max(0, space - _address_space_used()))
    return min(limits, default=None)


def address_space() -> int | None:
    """Return how many bytes of addresses this process may have, None if without limit."""
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def need_space(size: int, what: str) -> None:
    """Raise `SpherekitError` where `what` needs more addresses than this process may have.

    Libraries of other languages would end the process as they load.
    """
    space = address_space()
    if space is not None and space < size:
        raise SpherekitError(
            f"{what} about {size / 1e6:.0f} MB of addresses, and this process may have "
            f"{space / 1e6:.0f} MB (ulimit -v {space // 1024}); allow more"
        )


def _address_space_used() -> int:
    try:
        pages = Path("/proc/self/statm").read_text("ascii").split()[0]
        return int(pages) * os.sysconf("SC_PAGE_SIZE")
    except OSError:  # not on macOS
        return 0


def _group_limits() -> Iterator[int]:
    """Yield the limits of the control groups and of those around them, of both versions."""
    try:
        lines = MEMBERSHIP.read_text("utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        _, kinds, path = line.split(":", 2)
        if kinds and "memory" not in kinds.split(","):
            continue
        root = GROUPS / "memory" if kinds else GROUPS
        name = "memory.limit_in_bytes" if kinds else "memory.max"
        place = root / path.lstrip("/")
        for folder in (place, *place.parents):
            with suppress(OSError, ValueError):  # not there, or "max"
                yield int((folder / name).read_text("ascii"))
