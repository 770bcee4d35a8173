"""Chains of up to 60 links, in which errors grow from dyad to dyad."""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.extremes.parallel import judge_reference_pose
from benchmarks.extremes.registry import Row, case
from benchmarks.samples import grow_chain

CHAINS_FAMILY = "long chains"
LINKS = "links"
CHAIN_LINK_COUNTS = (4.0, 8.0, 12.0, 20.0, 32.0, 44.0, 60.0)
QUICK_CHAIN_LINK_COUNTS = (8.0, 20.0)


def judge_chains(counts: Sequence[float], has_triads: bool) -> Iterator[Row]:
    """Yield the rows of chains with these numbers of links in their reference pose."""
    for count in counts:
        mechanism = grow_chain(np.random.default_rng(3), int(count), has_triads)
        yield from judge_reference_pose(mechanism, count, derivatives=False)


@case(CHAINS_FAMILY, LINKS, CHAIN_LINK_COUNTS, QUICK_CHAIN_LINK_COUNTS)
def dyads_on_dyads(counts: Sequence[float]) -> Iterator[Row]:
    """A four-bar with dyads added at random links."""
    yield from judge_chains(counts, has_triads=False)


@case(CHAINS_FAMILY, LINKS, CHAIN_LINK_COUNTS, QUICK_CHAIN_LINK_COUNTS)
def dyads_and_triads(counts: Sequence[float]) -> Iterator[Row]:
    """A four-bar with dyads and triads added at random links."""
    yield from judge_chains(counts, has_triads=True)
