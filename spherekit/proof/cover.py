"""Which boxes lie in some piece of some chain."""

from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import TURN
from spherekit.numeric.turns import wrap
from spherekit.proof.chains import Chain
from spherekit.proof.tubes import UP
from spherekit.sphere.rotation import Floats

NEIGHBOURS = 8
"""Pieces with the nearest centres that a box is tried against."""


@final
class Cover:
    """All pieces of chains, searched by place."""

    def __init__(self) -> None:
        self.chains: list[Chain] = []
        self.count = 0

    def add(self, chain: Chain) -> None:
        """Take a chain; those that lie on it, if it is closed, are of no more use."""
        from scipy.spatial import cKDTree

        if chain.closed:
            self.chains = [kept for kept in self.chains if not _on(kept, chain)]
        self.chains.append(chain)
        pieces = [piece for member in self.chains for piece in member.pieces]
        self.count = len(pieces)
        self._centres = np.array([piece.centre for piece in pieces])
        self._frames = np.array([piece.frame for piece in pieces])
        self._limits = np.array([piece.limits for piece in pieces])
        box = np.full(self._centres.shape[1], TURN)
        self._tree = cKDTree(_turned(self._centres), boxsize=box)

    def covers(self, centres: Floats, radii: Floats) -> NDArray[np.bool_]:
        """Return whether boxes (n, v) of radii (n, v) are inside a piece."""
        out = np.zeros(len(centres), dtype=bool)
        if not self.count:
            return out
        small = np.flatnonzero(np.max(radii, axis=1) < np.max(self._limits))
        tried = min(NEIGHBOURS, self.count)
        _, near = self._tree.query(_turned(centres[small]), k=tried)
        near = np.asarray(near).reshape(len(small), tried)
        for column in range(tried):
            left = np.flatnonzero(~out[small])
            rows, pieces = small[left], near[left, column]
            frames = self._frames[pieces]
            apart = centres[rows] - self._centres[pieces]
            apart = wrap(apart)
            inside = np.abs(np.einsum("nv,nvw->nw", apart, frames))
            inside += np.einsum("nv,nvw->nw", radii[rows], np.abs(frames)) * UP + 1e-13
            out[rows] = np.all(inside <= self._limits[pieces], axis=1)
        return out

    def may_hold(self, place: Floats, off: float) -> bool:
        """Return whether a configuration, off by at most `off`, may be in a piece."""
        if not self.count:
            return False
        apart = wrap(place - self._centres)
        inside = np.abs(np.einsum("nv,nvw->nw", apart, self._frames)) - off - 1e-13
        return bool(np.any(np.all(inside <= self._limits, axis=1)))


def _on(chain: Chain, closed: Chain) -> bool:
    """Return whether a chain's curve is proven to be that of a closed one."""
    start = chain.start
    return any(piece.holds(start.centre, start.miss) for piece in closed.pieces)


def _turned(places: Floats) -> Floats:
    """Return angles in [0, 2 pi)."""
    turned = np.remainder(places, TURN)
    return np.asarray(np.where(turned >= TURN, 0.0, turned))
