"""The random mechanisms of the tests."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from spherekit.mechanism.mechanism import Mechanism

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import chains
import mode_counts

from spherekit.arrays import Floats

EIGHT_BARS: Sequence[Sequence[tuple[int, int]]] = chains.EIGHT_BARS
mechanism: Callable[..., Mechanism] = chains.mechanism
random_axes: Callable[..., Floats] = chains.random_axes
grown: Callable[..., Mechanism] = chains.grown
ten_bar: Callable[[int], Mechanism] = mode_counts.ten_bar
