"""Cache of results that were computed for mechanisms, for the life of the process."""

from collections.abc import Callable
from threading import RLock
from typing import Any, TypeVar

from spherekit.mechanism.mechanism import Mechanism

Result = TypeVar("Result")


class MechanismCache:
    """Stored results, found by the content of a mechanism and a request.

    The content is a text with everything but source, description, user data and unit of
    angles. Mechanisms with equal content share their results.

    Parameters
    ----------
    max_results
        Largest number of stored results. Beyond it, the result that was not used for the
        longest time is removed. None means no limit.
    """

    def __init__(self, max_results: int | None = None) -> None:
        """Begin without results."""
        self._max_results = max_results
        # A dict has the order of insertion, so the least recently used result comes first.
        self._results: dict[tuple[str, str], Any] = {}
        # Locked also during a computation, so that two threads do not compute one result
        # twice.
        self._lock = RLock()

    def get(
        self, mechanism: Mechanism, request: str, compute: Callable[[], Result]
    ) -> Result:
        """Return the result of a request, computed only if it is not in the cache.

        Parameters
        ----------
        mechanism
            The mechanism. Its content is part of the key.
        request
            Text that states everything else on which the result depends.
        compute
            Function that computes the result.
        """
        key = mechanism.content, request
        # Other threads wait until the result is computed.
        with self._lock:
            # Removing and inserting the result again makes it the most recently used one.
            is_cached = key in self._results
            result: Result = self._results.pop(key) if is_cached else compute()
            self._results[key] = result
            if self._max_results is not None and len(self._results) > self._max_results:
                del self._results[next(iter(self._results))]
        return result

    def has(self, mechanism: Mechanism, request: str) -> bool:
        """Return whether the cache has the result of a request."""
        return (mechanism.content, request) in self._results

    def clear(self) -> None:
        """Remove all results."""
        self._results.clear()
