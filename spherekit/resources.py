"""The processor cores and the memory that this process may use."""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from spherekit.errors import SpherekitError

GROUP_MEMBERSHIP = Path("/proc/self/cgroup")
"""File of Linux with the control groups to which this process belongs."""

GROUP_LIMITS = Path("/sys/fs/cgroup")
"""Folder of Linux with the limits of all control groups."""


def usable_cores() -> int:
    """Return the number of cores that this process may use, at least 1."""
    try:
        return max(1, len(os.sched_getaffinity(0)))
    except AttributeError:  # not available on Windows and macOS
        return os.cpu_count() or 1


def usable_memory() -> int:
    """Return the memory (bytes) that this process may use.

    It is the smallest of three numbers: the memory of the machine, the rest of the address
    space (``ulimit -v``), and the limit of the container (a Linux control group).
    """
    import psutil

    # psutil does not know the limits of control groups.
    limits = [psutil.virtual_memory().total, *_control_group_limits()]
    total_address_space = address_space()
    if total_address_space is not None:
        used_address_space = psutil.Process().memory_info().vms
        limits.append(max(0, total_address_space - used_address_space))
    return min(limits)


def address_space() -> int | None:
    """Return the limit of the address space (bytes) of this process, None without one."""
    try:
        import resource
    except ImportError:  # not available on Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def need_space(size: int, what: str) -> None:
    """Raise an error if the address space of this process is too small for a library.

    Without the check, libraries in other languages would end the process when they load.

    Parameters
    ----------
    size
        Required address space (bytes).
    what
        Beginning of the message, such as "recordings need".

    Raises
    ------
    SpherekitError
        If the limit of the address space (``ulimit -v``) is smaller than `size`.
    """
    limit = address_space()
    if limit is not None and limit < size:
        raise SpherekitError(
            f"{what} about {size / 1e6:.0f} MB of address space, but this process is "
            f"limited to {limit / 1e6:.0f} MB (ulimit -v {limit // 1024}); raise the limit"
        )


def _control_group_limits() -> Iterator[int]:
    """Yield the memory limits (bytes) that Linux sets for this process by control groups.

    Containers use control groups. The groups are nested, and each of them may have a limit.
    The two versions of control groups store limits in different files. On other systems
    nothing is yielded.
    """
    try:
        # Names of groups are bytes, as those of files; they need not be UTF-8.
        lines = os.fsdecode(GROUP_MEMBERSHIP.read_bytes()).split("\n")
    except OSError:
        return
    for line in filter(None, lines):
        # A line is number:controllers:path. Version 1 lists the controllers of the group
        # (such as memory), version 2 lists none.
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root = GROUP_LIMITS / "memory" if controllers else GROUP_LIMITS
        file_name = "memory.limit_in_bytes" if controllers else "memory.max"
        group_folder = root / path.lstrip("/")
        # The groups around the group have limits too.
        for folder in (group_folder, *group_folder.parents):
            with suppress(OSError, ValueError):  # the file is missing, or contains "max"
                yield int((folder / file_name).read_text("ascii"))
