"""What has been made for a mechanism, for the life of the process."""

from collections.abc import Callable
from dataclasses import replace
from threading import RLock
from typing import Any, TypeVar, final
from weakref import finalize, ref

from spherekit.files.write import canonical_text
from spherekit.model.mechanism import Mechanism

Made = TypeVar("Made")


@final
class Cache:
    """What was made for a mechanism's content and a request; the last `most`, if given."""

    def __init__(self, most: int | None = None) -> None:
        self._most = most
        self._kept: dict[tuple[str, str], Any] = {}
        self._making = RLock()  # held meanwhile, so that two threads do not make it twice

    def get(self, mechanism: Mechanism, request: str, make: Callable[[], Made]) -> Made:
        """Return what was made before for this content and request, or make it now."""
        key = _key(mechanism, request)
        with self._making:
            made: Made = self._kept.pop(key) if key in self._kept else make()
            self._kept[key] = made
            if self._most is not None and len(self._kept) > self._most:
                del self._kept[next(iter(self._kept))]
        return made

    def known(self, mechanism: Mechanism, request: str) -> bool:
        """Return whether something was made before for this content and request."""
        return _key(mechanism, request) in self._kept

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()


def _key(mechanism: Mechanism, request: str) -> tuple[str, str]:
    record = _TEXTS.get(id(mechanism))
    if record is None or record[0]() is not mechanism:
        text = canonical_text(replace(mechanism, user={}, source=None), "rad")
        record = _TEXTS[id(mechanism)] = ref(mechanism), text
        finalize(mechanism, _TEXTS.pop, id(mechanism), None).atexit = False
    return record[1], request


_TEXTS: dict[int, tuple[ref[Mechanism], str]] = {}
"""The contents of mechanisms that are alive, by their identity."""


COMPILED = Cache()
"""Kernels and equations of motion that were compiled."""
