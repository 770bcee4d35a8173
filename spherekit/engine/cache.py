"""What has been compiled, for the life of the process."""

from collections.abc import Callable
from dataclasses import replace
from threading import RLock
from typing import Any, TypeVar

from spherekit.files.write import canonical_text
from spherekit.model.mechanism import Mechanism

Made = TypeVar("Made")

_kept: dict[tuple[str, str], Any] = {}
_making = RLock()
"""Held while something is compiled, so that two threads do not compile it twice."""


def cached(mechanism: Mechanism, request: str, make: Callable[[], Made]) -> Made:
    """Return what was made before for this content and request, or make it now."""
    key = _key(mechanism, request)
    with _making:
        if key not in _kept:
            _kept[key] = make()
        made: Made = _kept[key]
    return made


def known(mechanism: Mechanism, request: str) -> bool:
    """Return whether something was made before for this content and request."""
    return _key(mechanism, request) in _kept


def _key(mechanism: Mechanism, request: str) -> tuple[str, str]:
    return canonical_text(replace(mechanism, user={}, source=None), "rad"), request


def clear() -> None:
    """Forget everything compiled."""
    _kept.clear()
