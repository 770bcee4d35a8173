"""What was computed for mechanisms before, kept for the life of the process."""

from collections.abc import Callable
from threading import RLock
from typing import Any, TypeVar

from spherekit.mechanism.mechanism import Mechanism

Made = TypeVar("Made")


class Cache:
    """What was made for a mechanism's content and a request; the last `most`, if given."""

    def __init__(self, most: int | None = None) -> None:
        self._most = most
        self._kept: dict[tuple[str, str], Any] = {}
        self._making = RLock()  # held meanwhile, so that two threads do not make it twice

    def get(self, mechanism: Mechanism, request: str, make: Callable[[], Made]) -> Made:
        """Return what was made before for this content and request, or make it now."""
        key = mechanism.content, request
        with self._making:
            made: Made = self._kept.pop(key) if key in self._kept else make()
            self._kept[key] = made
            if self._most is not None and len(self._kept) > self._most:
                del self._kept[next(iter(self._kept))]
        return made

    def known(self, mechanism: Mechanism, request: str) -> bool:
        """Return whether something was made before for this content and request."""
        return (mechanism.content, request) in self._kept

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()
