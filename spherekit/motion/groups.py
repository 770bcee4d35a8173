"""Placing the bodies of one group: dyads in closed form, others by Newton's method.

While groups are assembled each body carries the orientations of its links in its own
axes (those of one of its links); `State` holds them for a batch of samples.
"""

from dataclasses import dataclass, field
from typing import final

import numpy as np

from spherekit.motion.closure import Closure, LoopTree, NewtonResult
from spherekit.planning.assembly import Group
from spherekit.sphere.rotation import Floats, about_z, transpose
from spherekit.sphere.triangle import Bools, close_dyad


@final
@dataclass
class State:
    """Orientations of links within their bodies while a batch is being assembled.

    `first`, `second` (p, 3, 3) are the pair frames in link axes; `within[link]` is
    (n, 3, 3), from the link's axes to those of its body; `values` (n, p) are the pair
    variables known so far.
    """

    first: Floats
    second: Floats
    within: dict[int, Floats]
    values: Floats
    lost: Bools = field(default_factory=lambda: np.zeros(0, dtype=bool))

    @staticmethod
    def start(
        first: Floats,
        second: Floats,
        links: int,
        driven: int,
        ends: tuple[int, int],
        q: Floats,
    ) -> "State":
        """Return the state in which only the input pair has been given values q (n,)."""
        n = len(q)
        within = {link: np.broadcast_to(np.eye(3), (n, 3, 3)) for link in range(links)}
        within[ends[1]] = first[driven] @ about_z(q) @ transpose(second[driven])
        values = np.full((n, len(first)), np.nan)
        values[:, driven] = q
        return State(first, second, within, values, np.zeros(n, dtype=bool))

    def copy(self) -> "State":
        """Return a state that can be assembled differently from here on."""
        return State(
            self.first,
            self.second,
            dict(self.within),
            self.values.copy(),
            self.lost.copy(),
        )

    def repeat(self, times: int) -> "State":
        """Return the state of a single sample, repeated."""
        return State(
            self.first,
            self.second,
            {k: np.repeat(v, times, axis=0) for k, v in self.within.items()},
            np.repeat(self.values, times, axis=0),
            np.repeat(self.lost, times),
        )

    def axis(self, pair: int, link: int, is_first: bool) -> Floats:
        """Return the axis (n, 3) of a pair in the axes of the body that holds `link`."""
        frame = self.first[pair] if is_first else self.second[pair]
        return np.asarray(self.within[link] @ frame[:, 2])

    def merge(self, group: Group, placed: Floats) -> None:
        """Make the group one body, its bodies placed (n, bodies, 3, 3) in the first."""
        for position, links in enumerate(group.bodies):
            if position:
                for link in links:
                    self.within[link] = placed[:, position] @ self.within[link]

    def read_values(self, group: Group, ends: tuple[tuple[int, int], ...]) -> None:
        """Set the variables of the group's pairs from the orientations of its links."""
        for pair in group.pairs:
            a, b = ends[pair]
            one = self.within[a] @ self.first[pair]
            other = self.within[b] @ self.second[pair]
            cosine = np.sum(one[..., 0] * other[..., 0], axis=-1)
            sine = np.sum(one[..., 1] * other[..., 0], axis=-1)
            self.values[:, pair] = np.arctan2(sine, cosine)


def place_dyad(
    state: State, group: Group, ends: tuple[tuple[int, int], ...], sign: float
) -> Floats:
    """Place the two free bodies of a dyad and merge; return the sine of its dead centre.

    The mode's `sign` is that of u_1 . (u_2 x u_3), the axes of the group's pairs in
    file order. Samples whose arcs cannot close are marked in `state.lost`.
    """

    def joint(a: int, b: int) -> int:
        return next(k for k, pair in enumerate(group.ends) if set(pair) == {a, b})

    near, middle, far = joint(0, 1), joint(1, 2), joint(0, 2)

    def axis(which: int, body: int) -> Floats:
        pair = group.pairs[which]
        is_first = group.ends[which][0] == body
        return state.axis(pair, ends[pair][0 if is_first else 1], is_first)

    order = (middle, near, far)
    even = order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    near_turn, far_turn, sine, closes = close_dyad(
        axis(near, 0),
        axis(far, 0),
        (axis(near, 1), axis(middle, 1)),
        (axis(far, 2), axis(middle, 2)),
        sign if even else -sign,
    )
    n = len(state.values)
    placed = np.broadcast_to(np.eye(3), (n, 3, 3, 3)).copy()
    placed[:, 1], placed[:, 2] = near_turn, far_turn
    state.merge(group, placed)
    state.read_values(group, ends)
    state.lost |= ~closes
    return sine


def group_closure(state: State, group: Group, ends: tuple[tuple[int, int], ...]) -> Closure:
    """Return the closure of the group's bodies at the state's samples."""
    pairs = list(group.pairs)
    first = [state.within[ends[p][0]] @ state.first[p] for p in pairs]
    second = [state.within[ends[p][1]] @ state.second[p] for p in pairs]
    tree = LoopTree(len(group.bodies), group.ends)
    return Closure(tree, np.stack(first, axis=1), np.stack(second, axis=1))


def place_group(
    state: State, group: Group, ends: tuple[tuple[int, int], ...], start: Floats
) -> NewtonResult:
    """Close an irreducible group from starting values (n, its pairs), and merge it."""
    closure = group_closure(state, group, ends)
    result = closure.solve(start, held=None)
    state.merge(group, closure.orientations(result.values))
    state.values[:, list(group.pairs)] = result.values
    return result
