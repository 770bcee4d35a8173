"""The processor cores that this process may use."""

import os


def usable_cores() -> int:
    """Return how many cores this process may use, at least 1."""
    try:
        return max(1, len(os.sched_getaffinity(0)))
    except AttributeError:  # not on Windows and macOS
        return os.cpu_count() or 1
