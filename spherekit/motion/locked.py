"""Loops with some pairs locked: their links are one body, their variables constants."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.motion.closure import Closure
from spherekit.motion.loops import LoopTree
from spherekit.sphere.rotation import Floats, transpose


@final
@dataclass(frozen=True)
class Locked:
    """A closure with some variables locked, and the way back to all variables.

    `closure` has the variables `kept` of the whole closure, in order; `values` (V,) holds
    the locked ones.
    """

    closure: Closure
    kept: tuple[int, ...]
    values: Floats

    def whole(self, values: Floats) -> Floats:
        """Return all variables (n, V) from those kept."""
        out = np.tile(self.values, (len(values), 1))
        out[:, list(self.kept)] = values
        return out

    def rates(self, rates: Floats) -> Floats:
        """Return the rates (n, V) of all variables from those of the variables kept."""
        out = np.zeros((len(rates), len(self.values)))
        out[:, list(self.kept)] = rates
        return out


def lock(closure: Closure, held: Mapping[int, float]) -> Locked:
    """Return a closure of constant pair frames with R pairs or rolling contacts locked.

    `held` has the value (rad) of each locked pair's variable, by the variable's number.
    Where locked pairs close a loop of their own, the last of them is taken to fit.
    """
    tree = closure.tree
    values = np.zeros(len(tree.owners))
    for variable, value in held.items():
        values[variable] = value
    states = closure.at(values[None]).states
    first, second = states.first[0], states.second[0]
    body = list(range(tree.count))
    lift = [np.eye(3)] * tree.count
    for variable in held:
        pair = tree.owners[variable]
        a, b = tree.ends[pair]
        turn = lift[a] @ first[pair] @ transpose(lift[b] @ second[pair])
        keep, drop = body[a], body[b]
        if keep == drop:
            continue
        if keep > drop:
            keep, drop, turn = drop, keep, transpose(turn)
        for link in [k for k, owner in enumerate(body) if owner == drop]:
            body[link], lift[link] = keep, turn @ lift[link]
    number = {owner: k for k, owner in enumerate(sorted(set(body)))}
    locked = {tree.owners[variable] for variable in held}
    pairs = [pair for pair in range(len(tree.ends)) if pair not in locked]
    place = {pair: k for k, pair in enumerate(pairs)}
    kept = tuple(v for v, owner in enumerate(tree.owners) if owner not in locked)
    ends = tuple(
        (number[body[a]], number[body[b]]) for a, b in (tree.ends[p] for p in pairs)
    )
    leads = []
    for which in (0, 1):
        lifted = np.array([lift[tree.ends[pair][which]] for pair in pairs]).reshape(
            -1, 3, 3
        )
        if closure.leads is not None:
            lifted = lifted @ closure.leads[which][0][pairs]
        leads.append(lifted[None])
    return Locked(
        Closure(
            LoopTree(len(number), ends, tuple(place[tree.owners[v]] for v in kept)),
            tuple(closure.joints[pair] for pair in pairs),
            (leads[0], leads[1]),
        ),
        kept,
        values,
    )
