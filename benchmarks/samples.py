"""The random mechanisms and oracles of the tests."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import chains
import mode_counts
import random_mechanisms
from mode_judge import Structure
from oracles import link_rates, null_space, off_axis

__all__ = [
    "EIGHT_BARS",
    "Structure",
    "grown",
    "link_rates",
    "mechanism",
    "null_space",
    "off_axis",
    "random_axes",
    "random_chain",
    "random_mechanism",
    "ten_bar",
    "vector",
    "with_contacts",
]

EIGHT_BARS: Sequence[Sequence[tuple[int, int]]] = chains.EIGHT_BARS
mechanism: Callable[..., Mechanism] = chains.mechanism
random_axes: Callable[..., Floats] = chains.random_axes
random_chain: Callable[..., Sequence[tuple[int, int]]] = chains.random_chain
grown: Callable[..., Mechanism] = chains.grown
with_contacts: Callable[..., Mechanism] = chains.with_contacts
vector: Callable[[Floats], tuple[float, float, float]] = chains.vector
random_mechanism: Callable[[int], tuple[str, Mechanism]] = (
    random_mechanisms.random_mechanism
)
ten_bar: Callable[[int], Mechanism] = mode_counts.ten_bar
