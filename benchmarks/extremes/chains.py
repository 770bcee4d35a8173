"""Chains of up to 60 links: errors grow from dyad to dyad."""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.extremes.parallel import at_pose
from benchmarks.extremes.registry import Row, case
from benchmarks.samples import grow_chain

FAMILY = "long chains"
LINKS = "links"
COUNTS = (4.0, 8.0, 12.0, 20.0, 32.0, 44.0, 60.0)
FEW = (8.0, 20.0)


def chain(counts: Sequence[float], triads: bool) -> Iterator[Row]:
    """Yield rows of grown chains in their reference pose."""
    for count in counts:
        made = grow_chain(np.random.default_rng(3), int(count), triads)
        yield from at_pose(made, count, derivatives=False)


@case(FAMILY, LINKS, COUNTS, FEW)
def dyads_on_dyads(counts: Sequence[float]) -> Iterator[Row]:
    """A four-bar with dyads added at random links."""
    yield from chain(counts, triads=False)


@case(FAMILY, LINKS, COUNTS, FEW)
def dyads_and_triads(counts: Sequence[float]) -> Iterator[Row]:
    """A four-bar with dyads and triads added at random links."""
    yield from chain(counts, triads=True)
