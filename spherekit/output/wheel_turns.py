"""The turns of the inputs at which wheels stand as a posed configuration has them.

With its output held, a mechanism is closed by its wheels in any mesh, and its inputs are
known to whole turns. But a file means one assembly, in which the lengths rolled follow
from the inputs over any number of turns (`spherekit.motion.meshes`): of the others no
input leads to the pose, and half a turn of a carrier is a whole one of its side gear.
"""

from collections.abc import Sequence
from itertools import islice, product

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE, TURN
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.meshes import (
    MOST_ASSEMBLIES,
    MOST_SORTED,
    MOST_TURNS,
    SAME_RATIO,
    Meshes,
    whole_turns_apart,
)
from spherekit.numeric.turns import wrap
from spherekit.planning.wheels import SAME_LENGTH
from spherekit.sphere.rotation import Floats


def as_assembled(held: Solver, released: Solver, values: Floats) -> Floats | None:
    """Return a configuration of the assembly that a file means, None if there is none.

    Parameters
    ----------
    held
        The mechanism with its output held, whose variables are first those of `released`.
    released
        The mechanism itself, its lengths rolled known at its inputs.
    values
        (variables,) rad of `held`, closed, its wheels in any mesh.

    Returns
    -------
    (variables,) rad with the inputs at the turns that the lengths rolled say: of those
    that differ by whole turns of wheels, the one whose inputs are least in sum.
    """
    meshes = released.meshes
    if meshes is None or not meshes.variables:
        return values
    driven, rolled = list(released.driven), list(meshes.variables)
    lengths = _lengths(held, meshes, values[rolled])
    tried = np.repeat(values[None], len(lengths), axis=0)
    tried[:, rolled] = lengths
    with np.errstate(invalid="ignore", divide="ignore"):
        closed = held.closure.solve(tried, [*held.driven, *rolled], iterations=30)
    best, least = None, np.inf
    for whole in closed.values[closed.residual < CLOSURE_TOLERANCE]:
        q = _turned(meshes, wrap(whole[driven]), whole[rolled])
        if q is not None and np.sum(np.abs(q)) < least - SAME_LENGTH:
            best, least = whole.copy(), float(np.sum(np.abs(q)))
            best[driven] = q
    return best


def _lengths(held: Solver, meshes: Meshes, lengths: Floats) -> Floats:
    """Return lengths (n, m) whole turns of wheels from some, as inputs can roll them."""
    joints = [held.closure.joints[held.closure.tree.owners[v]] for v in meshes.variables]
    choices = map(whole_turns_apart, joints, map(float, lengths))
    every = np.array(list(islice(product(*choices), MOST_SORTED)))
    ratios = meshes.ratios
    onto = ratios @ np.linalg.pinv(ratios)
    beyond = every - meshes.lengths
    rollable = np.max(np.abs(beyond - beyond @ onto.T), axis=1) < SAME_LENGTH
    every = every[rollable]
    order = np.argsort(np.sum(np.abs(every), axis=1), kind="stable")
    return np.asarray(every[order[:MOST_ASSEMBLIES]])


def _turned(meshes: Meshes, q: Floats, lengths: Floats) -> Floats | None:
    """Return inputs (k,) whole turns from some that roll the lengths (m,), the least."""
    rolling = np.max(np.abs(meshes.ratios), axis=0, initial=0.0) > SAME_RATIO
    turns = [_turns(period) if moves else (0,) for moves, period in _each(meshes, rolling)]
    places = q + TURN * np.array(list(product(*turns)), dtype=float)
    off = np.max(np.abs(meshes.rolled(places) - lengths), axis=1)
    fits = places[off < SAME_LENGTH]
    if not len(fits):
        return None
    return np.asarray(fits[np.argmin(np.sum(np.abs(fits), axis=1))])


def _each(meshes: Meshes, rolling: Sequence[bool]) -> list[tuple[bool, float]]:
    return list(zip(rolling, map(float, meshes.periods), strict=True))


def _turns(period: float) -> range:
    """Return the whole turns of an input within half a period of none."""
    half = MOST_TURNS
    if np.isfinite(period):
        half = min(half, int(np.ceil(0.5 * period / TURN)))
    return range(-half, half + 1)
