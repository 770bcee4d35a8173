"""Random mechanisms, which are those of the tests."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from spherekit.mechanism.mechanism import Mechanism

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import chains
import mode_counts

from spherekit.arrays import Floats

EIGHT_BARS: Sequence[Sequence[tuple[int, int]]] = chains.EIGHT_BARS
"""The 16 chains of eight links and ten R pairs with one degree of freedom."""

make_mechanism: Callable[..., Mechanism] = chains.mechanism
"""Makes a mechanism of a chain and the axes (pairs, 3) of its reference pose."""

random_axes: Callable[..., Floats] = chains.random_axes
"""Returns random unit vectors (count, 3), from a random generator and their number."""

grow_chain: Callable[..., Mechanism] = chains.grown
"""Adds dyads, or dyads and triads, to random links of a four-bar.

Its arguments are a random generator, the number of links, and whether there are triads.
"""

make_ten_bar: Callable[[int], Mechanism] = mode_counts.ten_bar
"""Makes a random ten-bar whose locked structure is a group of nine bodies, by its seed."""
