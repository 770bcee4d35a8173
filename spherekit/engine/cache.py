"""What has been compiled, for the life of the process."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

from spherekit.files.write import canonical_text
from spherekit.model.mechanism import Mechanism

Made = TypeVar("Made")

_kept: dict[tuple[str, str], Any] = {}


def cached(mechanism: Mechanism, request: str, make: Callable[[], Made]) -> Made:
    """Return what was made before for this content and request, or make it now."""
    key = canonical_text(replace(mechanism, user={}, source=None), "rad"), request
    if key not in _kept:
        _kept[key] = make()
    made: Made = _kept[key]
    return made


def clear() -> None:
    """Forget everything compiled."""
    _kept.clear()
