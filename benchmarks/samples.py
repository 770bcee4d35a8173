"""Random mechanisms. The functions that make them are those of the tests."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from spherekit.mechanism.mechanism import Mechanism

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from mechanism_examples import linkages, searched_mechanisms

from spherekit.arrays import Floats

EIGHT_BARS: Sequence[Sequence[tuple[int, int]]] = linkages.EIGHT_BARS
"""The 16 chains of eight links and ten R pairs with one degree of freedom."""

make_mechanism: Callable[..., Mechanism] = linkages.mechanism_from_chain
"""Makes a mechanism of a chain and the axes (pairs, 3) of its reference pose."""

random_axes: Callable[..., Floats] = linkages.random_axes
"""Returns random unit vectors (count, 3), from a random generator and their number."""

grow_chain: Callable[..., Mechanism] = linkages.grow_dyad_chain
"""Adds dyads, or dyads and triads, to random links of a four-bar.

Its arguments are a random generator, the number of links, and whether there are triads.
"""

make_ten_bar: Callable[[int], Mechanism] = searched_mechanisms.ten_bar
"""Makes a random ten-bar whose locked structure is a group of nine bodies, by its seed."""
