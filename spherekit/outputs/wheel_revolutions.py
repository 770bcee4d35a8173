"""The revolutions of the inputs at which wheels stand as a posed configuration has them.

With its output held, a mechanism is closed by its wheels in any mesh, and its inputs are
known to whole turns. But a file means one assembly, in which the lengths rolled follow
from the inputs over any number of turns (`spherekit.positions.gear_phases`): of the others
no input leads to the pose, and half a turn of a carrier is a whole one of its side gear.
"""

from itertools import islice, product

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.planning.gear_mesh import SAME_LENGTH
from spherekit.positions.gear_phases import (
    GEAR_RATIO_TOLERANCE,
    MAX_INPUT_REVOLUTIONS,
    MAX_LENGTH_COMBINATIONS,
    MAX_TRIED_ASSEMBLIES,
    GearPhases,
    list_equivalent_lengths,
)
from spherekit.positions.position_solver import PositionSolver
from spherekit.tolerances import CLOSURE_TOLERANCE


def as_assembled(
    held: PositionSolver, released: PositionSolver, values: Floats
) -> Floats | None:
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
    meshes = released.gear_phases
    if meshes is None or not meshes.variables:
        return values
    driven, rolled = list(released.driven), list(meshes.variables)
    lengths = _lengths(held, meshes, values[rolled])
    tried = np.repeat(values[None], len(lengths), axis=0)
    tried[:, rolled] = lengths
    with np.errstate(all="ignore"):
        closed = held.closure.solve(tried, [*held.driven, *rolled], iterations=30)
    best, least = None, np.inf
    for whole in closed.values[closed.gap < CLOSURE_TOLERANCE]:
        q = _turned(meshes, wrap(whole[driven]), whole[rolled])
        if q is not None and np.sum(np.abs(q)) < least - SAME_LENGTH:
            best, least = whole.copy(), np.sum(np.abs(q))
            best[driven] = q
    return best


def _lengths(held: PositionSolver, meshes: GearPhases, lengths: Floats) -> Floats:
    """Return lengths (n, m) whole turns of wheels from some, as inputs can roll them."""
    joints = [held.closure.joints[held.closure.tree.owners[v]] for v in meshes.variables]
    choices = map(list_equivalent_lengths, joints, map(float, lengths))
    every = np.array(list(islice(product(*choices), MAX_LENGTH_COMBINATIONS)))
    ratios = meshes.ratios
    onto = ratios @ np.linalg.pinv(ratios)
    beyond = every - meshes.lengths
    every = every[max_abs(beyond - beyond @ onto.T, axis=1) < SAME_LENGTH]
    return every[
        np.argsort(np.sum(np.abs(every), axis=1), kind="stable")[:MAX_TRIED_ASSEMBLIES]
    ]


def _turned(meshes: GearPhases, q: Floats, lengths: Floats) -> Floats | None:
    """Return inputs (k,) whole turns from some that roll the lengths (m,), the least."""
    rolling = max_abs(meshes.ratios, axis=0) > GEAR_RATIO_TOLERANCE
    half = np.minimum(
        MAX_INPUT_REVOLUTIONS, np.ceil(0.5 * np.asarray(meshes.periods) / TURN)
    )
    turns = [range(-k, k + 1) for k in np.where(rolling, half, 0).astype(int).tolist()]
    places = q + TURN * np.array(list(product(*turns)), dtype=float)
    fits = places[max_abs(meshes.rolled_lengths(places) - lengths, axis=1) < SAME_LENGTH]
    if not len(fits):
        return None
    return fits[np.argmin(np.sum(np.abs(fits), axis=1))]
